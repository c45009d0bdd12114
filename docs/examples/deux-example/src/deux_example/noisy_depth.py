"""A simulator whose depth camera errs as a real one does, on top of any other simulator."""

import copy
from dataclasses import replace

import numpy as np

from deux.contracts import Action, Channels, Frame, Robot, SceneReference, Simulator
from deux.errors import DeuxError, check_range
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.registry import registry


class NoisyDepth(Simulator):
    """Another simulator with noise on its depth and pixels without depth.

    The noise is Gaussian with a standard deviation of factor x depth^2, as of a camera that triangulates (Khoshelham
    and Elberink, "Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications", Sensors 2012).
    Its random numbers are seeded with the camera's pose: a frame is the same however often and wherever it is drawn.

    Args:
        scene: where the robot is.
        camera: its camera; the range limits what the sensor reports, noise included.
        robot: its body and motion.
        colors: whether colours will be asked for.
        simulator: the registered name of the simulator whose depth is exact, with its default options.
        factor: standard deviation of the depth at 1 m, in metres; by default that of a Kinect.
        missing: probability that a pixel has no depth.

    Raises:
        DeuxError: a number is out of its range, or the exact simulator cannot be made.
    """

    def __init__(
        self,
        scene: SceneReference,
        camera: Camera,
        robot: Robot,
        colors: bool = True,
        simulator: str = "mesh",
        factor: float = 1.425e-3,
        missing: float = 0.02,
    ) -> None:
        check_range("simulator.factor", factor, 0.0)
        check_range("simulator.missing", missing, 0.0, 1.0)
        if issubclass(registry().get("simulators", simulator), NoisyDepth):
            raise DeuxError(f"simulator.simulator is {simulator!r}, which adds noise itself: name an exact simulator.")
        exact: Simulator = registry().create("simulators", simulator, {}, scene, _wider(camera), robot, colors)
        self.scene, self.camera, self.robot = scene, camera, robot
        self.label_names, self.floors = exact.label_names, exact.floors
        self._exact, self._factor, self._missing = exact, factor, missing

    @property
    def object_labels(self) -> tuple[str, ...]:
        """The label of each object that `Frame.objects` numbers."""
        return self._exact.object_labels

    def reset(self, x: float, z: float, yaw: float, floor: int = 0) -> None:
        """Put the robot on a floor; as `Simulator.reset`."""
        self._exact.reset(x, z, yaw, floor)

    def step(self, action: Action) -> bool:
        """Carry out one action; true if an obstacle cut it short."""
        return self._exact.step(action)

    @property
    def pose(self) -> np.ndarray:
        """The camera's present camera-to-world matrix, 4 x 4 float64."""
        return self._exact.pose

    def render(self, poses: np.ndarray, channels: Channels) -> list[Frame]:
        """What the camera records at each of N x 4 x 4 poses, drawn as one batch; the robot stays where it is."""
        return [self._measured(frame) for frame in self._exact.render(poses, channels)]

    def free_space(self, floor: int = 0) -> FreeSpace:
        """The true free part of a floor; as `Simulator.free_space`."""
        return self._exact.free_space(floor)

    def another(self, camera: Camera | None = None) -> "NoisyDepth":
        """A further robot in the same scene, with the same noise; what is loaded is shared."""
        simulator = copy.copy(self)
        simulator.camera = camera or self.camera
        simulator._exact = self._exact.another(_wider(simulator.camera))
        return simulator

    def _measured(self, frame: Frame) -> Frame:
        """The frame with noise and missing pixels; an object is seen only where there is depth."""
        # Rounded to a micrometre, and without -0.0, so that machines that compute a pose alike draw the same noise.
        seed = (np.round(frame.pose, 6) + 0.0).ravel().view(np.uint32)
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal(frame.depth.shape, dtype=np.float32)
        depth = frame.depth + np.float32(self._factor) * frame.depth**2 * noise
        seen = rng.random(frame.depth.shape) >= self._missing
        seen &= (depth >= self.camera.min_depth) & (depth <= self.camera.max_depth)
        objects = None if frame.objects is None else np.where(seen, frame.objects, np.int32(-1))
        return replace(frame, depth=np.where(seen, depth, np.float32(0.0)), objects=objects)


def _wider(camera: Camera) -> Camera:
    """The camera with a wider range, so that noise can carry a surface into the range as well as out of it."""
    return replace(camera, min_depth=camera.min_depth / 2, max_depth=camera.max_depth * 2)
