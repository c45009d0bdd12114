"""The built-in simulator: a robot in a scene that is a mesh, without physics or noise."""

import math
from functools import cached_property

import numpy as np

from deux.contracts import Action, Frame, Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.geometry.poses import camera_pose
from deux.scenes.free_space import free_space
from deux.scenes.scene import Scene
from deux.simulator.body import Body
from deux.simulator.renderers import Renderer, make_renderer


class MeshSimulator:
    """One robot in one scene; implements `deux.contracts.Simulator`.

    The robot moves exactly as it is told, slides along walls and keeps its camera level, `robot.camera_height` above
    the scene's floor. Call `reset` before anything that needs a pose. Renderer and free floor are made on first use.

    Args:
        scene: where the robot is.
        camera: its camera.
        robot: its body and motion.
        renderer: "embree" or "pyrender".
    """

    def __init__(self, scene: Scene, camera: Camera, robot: Robot, renderer: str = "embree") -> None:
        self.scene = scene
        self.camera = camera
        self.robot = robot
        self.label_names = scene.mesh.label_names
        self._renderer_name = renderer
        self._place: tuple[float, float, float] | None = None  # x, z, yaw

    def reset(self, x: float, z: float, yaw: float) -> None:
        """Put the robot on the floor at world (x, z), metres, heading `yaw` (radians, 0 looks along -Z).

        Raises:
            DeuxError: the robot does not fit there.
        """
        if not self._body.stands_at(x, z):
            raise DeuxError(
                f"the robot cannot stand at x={x:.3f}, z={z:.3f} in {self.scene.name}: the point is not on the free "
                f"floor, take one of simulator.free_space() or of random_starts()."
            )
        self._place = (x, z, yaw)

    def prepare(self) -> None:
        """Make now what is otherwise made on first use, such as before a simulator is copied.

        Raises:
            DeuxError: as `observe` and `free_space`.
        """
        _ = self._body, self._renderer

    def step(self, action: Action) -> bool:
        """Carry out one action; true if the robot touched something and moved less than it was told to."""
        x, z, yaw = self._standing
        collided = False
        if action == Action.FORWARD:
            x, z, collided = self._body.move(x, z, yaw, self.robot.forward_step)
        elif action == Action.LEFT:
            yaw += math.radians(self.robot.turn_angle)
        elif action == Action.RIGHT:
            yaw -= math.radians(self.robot.turn_angle)
        self._place = (x, z, yaw)
        return collided

    @property
    def pose(self) -> np.ndarray:
        """The camera's present camera-to-world matrix, 4 x 4 float64."""
        x, z, yaw = self._standing
        return camera_pose(x, self.scene.floor_height + self.robot.camera_height, z, yaw)

    def observe(self, labels: bool = False) -> Frame:
        """Render what the camera sees now.

        Raises:
            DeuxError: there is no such renderer, or its system libraries are missing.
        """
        pose = self.pose
        image = self._renderer.render(pose, labels)
        return Frame(image.rgb, image.depth, pose, image.labels)

    def depth(self) -> np.ndarray:
        """What `observe` would show as depth, H x W float32, without the cost of drawing colours."""
        return self._renderer.depth(self.pose)

    def labelled_depth(self) -> tuple[np.ndarray, np.ndarray]:
        """As `depth`, and with it the labels of `observe(labels=True)`, H x W int32."""
        return self._renderer.labelled_depth(self.pose)

    def free_space(self) -> FreeSpace:
        """The true free floor that is connected to the robot's main floor. Privileged: no agent sees it unasked.

        Raises:
            DeuxError: there is no floor that the robot fits on.
        """
        return self._free_space

    @property
    def _standing(self) -> tuple[float, float, float]:
        if self._place is None:
            raise DeuxError(f"the robot is not in {self.scene.name} yet: call reset() with a place first.")
        return self._place

    @cached_property
    def _free_space(self) -> FreeSpace:
        try:
            return free_space(self.scene.mesh, self.scene.floor_height, self.robot)
        except DeuxError as error:
            raise DeuxError(f"{self.scene.name}: {error}") from error

    @cached_property
    def _body(self) -> Body:
        return Body(self._free_space)

    @cached_property
    def _renderer(self) -> Renderer:
        return make_renderer(self._renderer_name, self.scene, self.camera)
