"""The simulator `habitat`: Habitat-Sim's scenes, pictures and navmesh behind the contract of simulators."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from deux.contracts import Action, Channel, Channels, Frame, Robot, SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.geometry.poses import camera_pose
from deux_plugins.simulators.habitat.drawing_context import FAR, NEAR
from deux_plugins.simulators.habitat.navmesh import sample_navmesh
from deux_plugins.simulators.habitat.semantics import Semantics, read_semantics
from deux_plugins.simulators.habitat.session import Session, import_habitat
from deux_plugins.simulators.habitat.storeys import Storey, find_storeys
from deux_plugins.simulators.habitat.survey import covered, ground

COLLISION = 1e-5  # square metres: Habitat-Sim's margin between a step and one that was cut short


class _Place(NamedTuple):
    """Where a robot is: on the navmesh (x, y, z in metres), its heading in radians, and the number of its floor."""

    point: np.ndarray
    yaw: float
    floor: int


@dataclass(frozen=True)
class _SharedScene:
    """An open scene and what is known about it, for all robots in it."""

    session: Session
    storeys: tuple[Storey, ...]
    semantics: Semantics


class HabitatSimulator(Simulator):
    """One robot in a scene file that Habitat-Sim 0.2.5 to 0.3.x reads.

    The robot moves on the navmesh by `PathFinder.try_step`, which is what Habitat-Sim's own `move_forward` does, and
    slides along walls. Its camera is level and `robot.camera_height` above the surface under it. Habitat-Sim's agents
    stand on the navmesh instead, which is up to one `cell_height` higher.

    Robots made by `another` share one Habitat-Sim: its only agent is the camera, placed anew for each picture.

    Args:
        scene: where the robot is: a scene in a file, such as those of scenes=files, mp3d, hm3d and gibson.
        camera: its camera.
        robot: its body and motion; the navmesh is made for them.
        colors: whether colours will be asked for; without them Habitat-Sim loads no textures.
        gpu: CUDA index of the card that draws, -1 for the first device that can; null: the card that PyTorch uses, and
            -1 where it sees none.
        dataset: a scene dataset configuration of Habitat-Sim's (*.scene_dataset_config.json) that lists the scene's
            file; null: one that is written for the scene, with the axes and the annotation as they are.
        semantics: whether the scene's annotation is loaded, from which labels and objects come.
        cell_size: edge of the navmesh's cells in metres.
        cell_height: height of the navmesh's cells in metres.

    Raises:
        DeuxError: Habitat-Sim is not installed, the scene is in no file or cannot be loaded, or the robot fits nowhere.
    """

    def __init__(
        self,
        scene: SceneReference,
        camera: Camera,
        robot: Robot,
        colors: bool = True,
        gpu: int | None = None,
        dataset: str | None = None,
        semantics: bool = True,
        cell_size: float = 0.05,
        cell_height: float = 0.2,
    ) -> None:
        session = Session(scene, camera, robot, colors, semantics, gpu, dataset, cell_size, cell_height)
        try:
            storeys = find_storeys(
                sample_navmesh(session.pathfinder),
                robot,
                scene.area,
                lambda *level: ground(session, *level),
                lambda *level: covered(session, *level),
            )
        except DeuxError as error:
            raise DeuxError(f"{scene.name}: {error}") from error
        self._begin(scene, camera, robot, _SharedScene(session, storeys, read_semantics(session.semantic_objects)))

    @staticmethod
    def lacking() -> str:
        """What keeps Habitat-Sim from being imported here; `python -m deux.doctor` asks for it."""
        try:
            import_habitat()
        except DeuxError as error:
            return str(error)
        return ""

    def _begin(self, scene: SceneReference, camera: Camera, robot: Robot, shared: _SharedScene) -> None:
        self.scene, self.camera, self.robot = scene, camera, robot
        self.floors = tuple(storey.floor for storey in shared.storeys)
        self.label_names = shared.semantics.label_names
        self._shared = shared
        self._place: _Place | None = None

    @property
    def object_labels(self) -> tuple[str, ...]:
        """The label of each annotated object."""
        return self._shared.semantics.object_labels

    def reset(self, x: float, z: float, yaw: float, floor: int = 0) -> None:
        """Put the robot on a floor at world (x, z), metres, heading `yaw` (radians, 0 looks along -Z).

        A place in a free cell that the navmesh covers in part is moved onto the navmesh, by less than a cell.

        Raises:
            DeuxError: the robot does not fit there, or there is no such floor.
        """
        storey = self._storey(floor)
        height = storey.navmesh_at(x, z)
        if height is not None:
            # Habitat-Sim itself would let the robot stand anywhere, off the navmesh too, and never move again.
            point = self._shared.session.snapped(np.array([x, height, z]))
            if math.dist((x, z), point[[0, 2]]) <= storey.space.frame.resolution:
                self._place = _Place(point, yaw, floor)
                return
        raise DeuxError(
            f"the robot cannot stand at x={x:.3f}, z={z:.3f} in {self.scene.name}: the point is not on the free floor, "
            "take one of simulator.free_space() or of random_starts()."
        )

    def step(self, action: Action) -> bool:
        """Carry out one action; true if the robot touched something and moved less than it was told to."""
        point, yaw, floor = self._standing
        collided = False
        if action == Action.FORWARD:
            length = self.robot.forward_step
            goal = point - length * np.array([math.sin(yaw), 0.0, math.cos(yaw)])
            end = self._shared.session.moved(point, goal)
            # A way that leads off the floor, up the stairs or out of the region ends where it begins.
            if self._storey(floor).ground_at(end[0], end[2]) is None:
                end = point
            collided = math.dist(point[[0, 2]], end[[0, 2]]) ** 2 + COLLISION < length**2
            point = end
        elif action == Action.LEFT:
            yaw += math.radians(self.robot.turn_angle)
        elif action == Action.RIGHT:
            yaw -= math.radians(self.robot.turn_angle)
        self._place = _Place(point, yaw, floor)
        return collided

    @property
    def pose(self) -> np.ndarray:
        """The camera's present camera-to-world matrix, 4 x 4 float64."""
        (x, _, z), yaw, floor = self._standing
        ground = self._storey(floor).ground_at(x, z)
        assert ground is not None, "a robot never leaves its floor"
        return camera_pose(x, ground + self.robot.camera_height, z, yaw)

    def render(self, poses: np.ndarray, channels: Channels) -> list[Frame]:
        """What the camera records at each of N x 4 x 4 poses; the robot stays where it is."""
        return [self._frame(np.array(pose, np.float64), channels) for pose in poses]

    def free_space(self, floor: int = 0) -> FreeSpace:
        """The largest connected free part of a floor: where the navmesh covers a cell's centre.

        Raises:
            DeuxError: there is no such floor.
        """
        return self._storey(floor).space

    def another(self, camera: Camera | None = None) -> HabitatSimulator:
        """A further robot in the same scene, with this camera or another one, drawn by the same Habitat-Sim."""
        simulator = HabitatSimulator.__new__(HabitatSimulator)
        simulator._begin(self.scene, camera or self.camera, self.robot, self._shared)
        return simulator

    @property
    def _standing(self) -> _Place:
        if self._place is None:
            raise DeuxError(f"the robot is not in {self.scene.name} yet: call reset() with a place first.")
        return self._place

    def _storey(self, floor: int) -> Storey:
        count = len(self._shared.storeys)
        if not 0 <= floor < count:
            raise DeuxError(f"{self.scene.name} has no floor {floor}: its floors are numbered 0 to {count - 1}.")
        return self._shared.storeys[floor]

    def _frame(self, pose: np.ndarray, channels: Channels) -> Frame:
        camera, session = self.camera, self._shared.session
        depth = session.depth(pose, camera, NEAR, max(FAR, camera.max_depth))
        depth[(depth < camera.min_depth) | (depth > camera.max_depth)] = 0.0
        rgb = session.color(pose, camera) if Channel.COLOR in channels else np.zeros((0, 0, 3), np.uint8)
        labels = objects = None
        if channels & {Channel.LABELS, Channel.OBJECTS}:
            labels, objects = self._annotation(pose)
            objects[depth == 0.0] = -1
        return Frame(
            rgb,
            depth,
            pose,
            labels if Channel.LABELS in channels else None,
            objects if Channel.OBJECTS in channels else None,
        )

    def _annotation(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Labels and objects at a pose, H x W int32 each."""
        if not self.label_names:
            nothing = np.full((self.camera.height, self.camera.width), -1, np.int32)
            return nothing, nothing.copy()
        return self._shared.semantics.images(self._shared.session.semantic(pose, self.camera))
