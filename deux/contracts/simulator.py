"""The contract of a simulator: one robot in one scene, its actions and its camera."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Any, overload

import numpy as np

from deux.broken_contracts import broken_contract
from deux.contracts.scene import Floor, SceneReference
from deux.errors import counted, kind_of, sizes
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.geometry.robot import Robot


class Action(IntEnum):
    """An action of the robot: one step."""

    FORWARD = 0
    LEFT = 1
    RIGHT = 2
    STOP = 3


class Channel(StrEnum):
    """A part of a frame besides depth; only requested channels are rendered."""

    COLOR = "color"
    LABELS = "labels"
    OBJECTS = "objects"


Channels = frozenset[Channel]

COLOR: Channels = frozenset({Channel.COLOR})
"""Depth and colour."""

DEPTH: Channels = frozenset()
"""Depth only."""


_ROUNDING = 1e-4
"""Maximal difference of a pose from the exact one, in metres and in entries of a rotation, if computed in float32."""


@dataclass(frozen=True)
class Frame:
    """The image of the robot's camera at one pose.

    Args:
        rgb: H x W x 3 uint8; 0 x 0 x 3 unless `Channel.COLOR` was requested.
        depth: H x W float32 in metres along the optical axis, 0 where no surface is within the camera's range.
        pose: 4 x 4 float64, camera-to-world.
        labels: H x W int32, index into `Simulator.label_names`, -1 where nothing is labelled; None unless requested.
        objects: H x W int32, index into `Simulator.object_labels`, -1 where no object is within the camera's range;
            None unless requested.
    """

    rgb: np.ndarray
    depth: np.ndarray
    pose: np.ndarray
    labels: np.ndarray | None = None
    objects: np.ndarray | None = None


class Simulator(ABC):
    """One robot in one scene.

    The constructor is called as `cls(scene, camera, robot, colors, **options)`, each option with a default, and keeps
    the first three arguments as attributes. `scene` is a `SceneReference`; if `colors` is false, no colours will be
    requested and textures need not be loaded.

    `reset` places the robot; call it before `step`, `pose` and `observe` without poses. Frames depend only on scene,
    camera and pose: neither earlier frames nor other frames of the same batch change a bit of them.
    """

    scene: SceneReference
    camera: Camera
    robot: Robot

    label_names: tuple[str, ...]
    """Names of the classes that `Frame.labels` indexes; empty if nothing is labelled."""

    floors: tuple[Floor, ...]
    """The floors of the scene that its `area` selects, the main one first."""

    @property
    def object_labels(self) -> tuple[str, ...]:
        """The label of each object that `Frame.objects` indexes; empty if no objects are known."""
        return ()

    @abstractmethod
    def reset(self, x: float, z: float, yaw: float, floor: int = 0) -> None:
        """Place the robot on a floor.

        Args:
            x: world x in metres.
            z: world z in metres.
            yaw: heading in radians, 0 along -Z, positive to the left.
            floor: index into `floors`.

        Raises:
            DeuxError: the robot does not fit there, or there is no such floor.
        """

    @abstractmethod
    def step(self, action: Action) -> bool:
        """Carry out one action.

        Returns:
            Whether an obstacle stopped the robot early: it moved less than `robot.forward_step`, if at all.
        """

    @property
    @abstractmethod
    def pose(self) -> np.ndarray:
        """The camera's current camera-to-world matrix, 4 x 4 float64."""

    @abstractmethod
    def render(self, poses: np.ndarray, channels: Channels) -> list[Frame]:
        """Render the camera's image at each of N x 4 x 4 poses as one batch; the robot does not move."""

    @overload
    def observe(self, channels: Channels = ..., poses: None = None) -> Frame: ...

    @overload
    def observe(self, channels: Channels, poses: np.ndarray) -> list[Frame]: ...

    def observe(self, channels: Channels = COLOR, poses: np.ndarray | None = None) -> Frame | list[Frame]:
        """Render the camera's image at the robot's pose or, with N x 4 x 4 poses, at each of these.

        Raises:
            DeuxError: the robot's pose is not a rigid matrix; or `render` returned the wrong number of frames, frames
                of other poses, arrays of the wrong shape or type, or depth outside the camera's range.
        """
        asked = _checked_pose(self)[None] if poses is None else poses
        frames = self.render(asked, channels)
        _check_frames(self, frames, asked, channels)
        return frames[0] if poses is None else frames

    @abstractmethod
    def free_space(self, floor: int = 0) -> FreeSpace:
        """The true free part of a floor within the scene's `area`, connected. Privileged: only explorers that declare
        `Need.FREE_SPACE` receive it.

        Raises:
            DeuxError: there is no room for the robot, or no such floor.
        """

    @abstractmethod
    def another(self, camera: Camera | None = None) -> Simulator:
        """A further robot in the same scene, with this camera or another; loaded data is shared, not copied."""


def _checked_pose(simulator: Simulator) -> np.ndarray:
    """The robot's pose; raises DeuxError unless it is a rigid matrix."""
    pose: Any = simulator.pose
    right = "a rigid camera-to-world matrix, 4 x 4 float64"
    if not (isinstance(pose, np.ndarray) and pose.shape == (4, 4) and pose.dtype == np.float64):
        raise broken_contract(simulator, kind_of(pose), right, "pose")
    rotation = pose[:3, :3]
    apart = np.abs(rotation @ rotation.T - np.eye(3)).max() + np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).max()
    if not (apart <= _ROUNDING and np.isfinite(pose).all()):
        raise broken_contract(simulator, f"the matrix {pose.round(3).tolist()}", right, "pose")
    return pose


def _check_frames(simulator: Simulator, frames: Any, poses: np.ndarray, channels: Channels) -> None:
    """Raise DeuxError unless these are frames of the poses, with arrays of the camera's size, right types and depth."""
    count = len(poses)
    several = isinstance(frames, list | tuple)
    odd = [kind_of(one) for one in frames if not isinstance(one, Frame)] if several else [kind_of(frames)]
    if odd or len(frames) != count:
        given = odd[0] if odd else counted(len(frames), "frame")
        right = f"a list with a deux.contracts.Frame for each pose, here {count}"
        raise broken_contract(simulator, given, right, "render")
    camera = simulator.camera
    size = (camera.height, camera.width)
    parts: list[tuple[str, tuple[int, ...], type]] = [("depth", size, np.float32), ("pose", (4, 4), np.float64)]
    if Channel.COLOR in channels:
        parts.append(("rgb", (*size, 3), np.uint8))
    parts += [(part, size, np.int32) for part in (Channel.LABELS, Channel.OBJECTS) if part in channels]
    for pose, frame in zip(poses, frames, strict=True):
        for name, shape, dtype in parts:
            array = getattr(frame, name)
            if not (isinstance(array, np.ndarray) and array.shape == shape and array.dtype == dtype):
                pixels = f"{camera.width} x {camera.height} pixels"
                right = f"an ndarray of {sizes(shape)}, {np.dtype(dtype)}, for its camera of {pixels}"
                raise broken_contract(simulator, f"a frame whose {name} is {kind_of(array)}", right, "render")
        nearest, farthest = frame.depth.min(), frame.depth.max()
        if not (nearest >= 0.0 and farthest <= camera.max_depth):  # true for NaN
            right = f"{camera.min_depth:g} to {camera.max_depth:g} m, the camera's range, or 0 for no surface"
            raise broken_contract(simulator, f"a frame with depth from {nearest:g} to {farthest:g} m", right, "render")
        if not np.abs(frame.pose - pose).max() <= _ROUNDING:
            right = "one of the pose that it was called with"
            raise broken_contract(simulator, "a frame of another pose", right, "render")
