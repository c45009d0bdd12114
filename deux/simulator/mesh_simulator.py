"""The built-in simulator: a robot in a mesh scene, without physics or noise."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from deux.contracts import Action, Channel, Channels, Frame, Material, Robot, Scene, SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.geometry.poses import camera_pose
from deux.scenes.loaded_scene import loaded_scene
from deux.scenes.objects import SceneObjects, find_objects
from deux.scenes.ray_caster import RayCaster
from deux.scenes.scene_floors import SceneFloors
from deux.simulator.body import Body
from deux.simulator.renderers import RenderedImage, Renderer, make_renderer

NO_COLORS = np.zeros((0, 0, 3), np.uint8)


class MeshSimulator(Simulator):
    """One robot in one scene that can be loaded as a mesh.

    The robot executes actions exactly, slides along walls and keeps its camera level, `robot.camera_height` above the
    surface under it, also on stairs and ramps. Renderers, free spaces and objects are computed on first use; only if
    the scene has several floors are their free spaces computed at once, to choose a floor by `scene.area`.

    Args:
        scene: the scene, which is loaded at once.
        camera: the robot's camera.
        robot: the robot's body and motion.
        colors: whether colours will be rendered; without textures a scene takes a tenth of the memory.
        renderer: Embree's ray casting on the CPU, or OpenGL by moderngl or pyrender, which need system libraries.

    Raises:
        DeuxError: the scene cannot be loaded, or has no such floor as `scene.area` selects.
    """

    def __init__(
        self,
        scene: SceneReference,
        camera: Camera,
        robot: Robot,
        colors: bool = True,
        renderer: Literal["embree", "gl", "pyrender"] = "embree",
    ) -> None:
        loaded = loaded_scene(scene)
        self._begin(
            scene, camera, robot, _SharedScene(scene, loaded if colors else _untextured(loaded), robot, renderer)
        )

    def _begin(self, scene: SceneReference, camera: Camera, robot: Robot, shared: "_SharedScene") -> None:
        self.scene, self.camera, self.robot = scene, camera, robot
        self.floors, self.label_names = shared.floors.floors, shared.scene.mesh.label_names
        self._shared = shared
        self._state: tuple[float, float, float, int] | None = None  # x and z from the mesh's origin, yaw, floor

    @property
    def object_labels(self) -> tuple[str, ...]:
        """The label of each object; objects are segmented on first use."""
        return self._shared.objects.labels

    def reset(self, x: float, z: float, yaw: float, floor: int = 0) -> None:
        """Put the robot on a floor at world (x, z), metres, heading `yaw` (radians, 0 looks along -Z).

        Raises:
            DeuxError: the robot does not fit there, or there is no such floor.
        """
        origin_x, _, origin_z = self._shared.scene.mesh.origin
        here_x, here_z = x - origin_x, z - origin_z
        if not self._shared.body(floor).stands_at(here_x, here_z):
            raise DeuxError(
                f"the robot cannot stand at x={x:.3f}, z={z:.3f} in {self.scene.name}, which is not on the free "
                f"floor: choose a point of simulator.free_space() or random_starts()."
            )
        self._state = (here_x, here_z, yaw, floor)

    def step(self, action: Action) -> bool:
        """Carry out one action; true if the robot collided and moved less than the action's distance."""
        x, z, yaw, floor = self._current_state
        collided = False
        if action == Action.FORWARD:
            x, z, collided = self._shared.body(floor).move(x, z, yaw, self.robot.forward_step)
        elif action == Action.LEFT:
            yaw += math.radians(self.robot.turn_angle)
        elif action == Action.RIGHT:
            yaw -= math.radians(self.robot.turn_angle)
        self._state = (x, z, yaw, floor)
        return collided

    @property
    def pose(self) -> np.ndarray:
        """The camera's current camera-to-world matrix, 4 x 4 float64."""
        x, z, yaw, floor = self._current_state
        mesh_x, mesh_y, mesh_z = self._shared.scene.mesh.origin
        height = self._shared.floors.mesh_space(floor).height_at(x, z) + self.robot.camera_height
        return camera_pose(x + mesh_x, height + mesh_y, z + mesh_z, yaw)

    def render(self, poses: np.ndarray, channels: Channels) -> list[Frame]:
        """Render the camera's frames at N x 4 x 4 camera-to-world poses; the robot does not move.

        Raises:
            DeuxError: the renderer's system libraries are missing.
        """
        faces = bool(channels & {Channel.LABELS, Channel.OBJECTS})
        here = np.array(poses, np.float64)
        here[:, :3, 3] -= self._shared.scene.mesh.origin
        images = self._shared.renderer(self.camera).render(here, Channel.COLOR in channels, faces)
        return [self._frame(image, pose, channels) for image, pose in zip(images, poses, strict=True)]

    def free_space(self, floor: int = 0) -> FreeSpace:
        """The connected free part of a floor that `scene.area` selects. Privileged information for explorers.

        Raises:
            DeuxError: the robot fits nowhere on it, or there is no such floor.
        """
        return self._shared.floors.free_space(floor)

    def another(self, camera: Camera | None = None) -> "MeshSimulator":
        """A further robot in the same scene, with this camera or another one; both share the loaded scene."""
        simulator = MeshSimulator.__new__(MeshSimulator)
        simulator._begin(self.scene, camera or self.camera, self.robot, self._shared)
        return simulator

    @property
    def _current_state(self) -> tuple[float, float, float, int]:
        if self._state is None:
            raise DeuxError(f"the robot is not in {self.scene.name} yet: call reset() with a place first.")
        return self._state

    def _frame(self, image: RenderedImage, pose: np.ndarray, channels: Channels) -> Frame:
        labels = objects = None
        if Channel.LABELS in channels:
            labels = self._shared.label_of_face[image.face]
        if Channel.OBJECTS in channels:
            objects = np.where(image.depth > 0.0, self._shared.object_of_face[image.face], np.int32(-1))
        return Frame(NO_COLORS if image.rgb is None else image.rgb, image.depth, np.array(pose, float), labels, objects)


@dataclass
class _SharedScene:
    """A loaded scene and everything computed from it on first use, shared by all robots in it and their cameras.

    Bodies and renderers use positions relative to the mesh's origin, for which float32 is precise enough.
    """

    reference: SceneReference
    scene: Scene
    robot: Robot
    renderer_name: str
    _bodies: dict[int, Body] = field(default_factory=dict)
    _renderers: dict[Camera, Renderer] = field(default_factory=dict)

    @cached_property
    def floors(self) -> SceneFloors:
        return SceneFloors(self.scene, self.reference.area, self.robot, self.caster)

    def body(self, floor: int) -> Body:
        if floor not in self._bodies:
            self._bodies[floor] = Body(self.floors.mesh_space(floor))
        return self._bodies[floor]

    def renderer(self, camera: Camera) -> Renderer:
        if camera not in self._renderers:
            if other := next(iter(self._renderers.values()), None):
                self._renderers[camera] = other.another(camera)
            else:
                self._renderers[camera] = make_renderer(self.renderer_name, self.scene.mesh, camera, self.caster)
        return self._renderers[camera]

    @cached_property
    def caster(self) -> RayCaster:
        return RayCaster(self.scene.mesh)

    @cached_property
    def objects(self) -> SceneObjects:
        return find_objects(self.scene.mesh)

    # The last entry is for face -1, "none".
    @cached_property
    def label_of_face(self) -> np.ndarray:
        return np.append(self.scene.mesh.face_label, -1).astype(np.int32)

    @cached_property
    def object_of_face(self) -> np.ndarray:
        return np.append(self.objects.face_object, np.int32(-1))


def _untextured(scene: Scene) -> Scene:
    materials = tuple(Material(material.name) for material in scene.mesh.materials)
    return replace(scene, mesh=replace(scene.mesh, materials=materials, pyramids=None))
