"""The contract of a simulator: one robot in one scene, what it can do and what its camera records."""

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
    """What the robot can do in one step."""

    FORWARD = 0
    LEFT = 1
    RIGHT = 2
    STOP = 3


class Channel(StrEnum):
    """What a frame may hold besides its depth; what is not asked for is not drawn."""

    COLOR = "color"
    LABELS = "labels"
    OBJECTS = "objects"


Channels = frozenset[Channel]

COLOR: Channels = frozenset({Channel.COLOR})
"""Depth with colours."""

DEPTH: Channels = frozenset()
"""Depth alone."""


@dataclass(frozen=True)
class Frame:
    """What the robot's camera records at one pose.

    Args:
        rgb: H x W x 3 uint8; 0 x 0 x 3 unless `Channel.COLOR` was asked for.
        depth: H x W float32 in metres along the optical axis, 0 where no surface is within the camera's range.
        pose: 4 x 4 float64, camera-to-world.
        labels: H x W int32, index into `Simulator.label_names`, -1 where nothing is labelled; None unless asked for.
        objects: H x W int32, index into `Simulator.object_labels`, -1 where no object is within the camera's range;
            None unless asked for.
    """

    rgb: np.ndarray
    depth: np.ndarray
    pose: np.ndarray
    labels: np.ndarray | None = None
    objects: np.ndarray | None = None


class Simulator(ABC):
    """One robot in one scene.

    A simulator is made as `cls(scene, camera, robot, colors, **options)`, and keeps the first three under these names.
    `scene` is a `SceneReference`; `colors` says whether colours will be asked for, without which no texture needs to be
    loaded. Further parameters of the constructor are its options, each with a default.

    `reset` puts the robot somewhere; `step`, `pose` and `observe` without poses come after it. Frames depend on scene,
    camera and pose alone: what was drawn before, and what is drawn in the same batch, changes no bit of them.
    """

    scene: SceneReference
    camera: Camera
    robot: Robot

    label_names: tuple[str, ...]
    """What the numbers in `Frame.labels` stand for; empty where nothing is labelled."""

    floors: tuple[Floor, ...]
    """The floors of the scene that its `area` chooses, the main one first."""

    @property
    def object_labels(self) -> tuple[str, ...]:
        """The label of each object that `Frame.objects` numbers; empty where no objects are known."""
        return ()

    @abstractmethod
    def reset(self, x: float, z: float, yaw: float, floor: int = 0) -> None:
        """Put the robot on a floor at world (x, z), metres, heading `yaw` (radians, 0 looks along -Z).

        Args:
            x: world x in metres.
            z: world z in metres.
            yaw: heading in radians, positive to the left.
            floor: index into `floors`.

        Raises:
            DeuxError: the robot does not fit there, or there is no such floor.
        """

    @abstractmethod
    def step(self, action: Action) -> bool:
        """Carry out one action.

        Returns:
            Whether an obstacle cut the action short: the robot moved less than `robot.forward_step`, if at all.
        """

    @property
    @abstractmethod
    def pose(self) -> np.ndarray:
        """The camera's present camera-to-world matrix, 4 x 4 float64."""

    @abstractmethod
    def render(self, poses: np.ndarray, channels: Channels) -> list[Frame]:
        """What the camera records at each of N x 4 x 4 poses, drawn as one batch; the robot stays where it is."""

    @overload
    def observe(self, channels: Channels = ..., poses: None = None) -> Frame: ...

    @overload
    def observe(self, channels: Channels, poses: np.ndarray) -> list[Frame]: ...

    def observe(self, channels: Channels = COLOR, poses: np.ndarray | None = None) -> Frame | list[Frame]:
        """What the camera records where the robot stands or, with N x 4 x 4 poses, at each of these.

        Raises:
            DeuxError: `render` gives another number of frames, or frames of another size or type than its camera's.
        """
        asked = self.pose[None] if poses is None else poses
        frames = self.render(asked, channels)
        _check_frames(self, frames, len(asked), channels)
        return frames[0] if poses is None else frames

    @abstractmethod
    def free_space(self, floor: int = 0) -> FreeSpace:
        """The true free part of a floor within the scene's `area`, all of it connected. Privileged: no agent sees it
        unasked.

        Raises:
            DeuxError: the robot fits nowhere on it, or there is no such floor.
        """

    @abstractmethod
    def another(self, camera: Camera | None = None) -> Simulator:
        """A further robot in the same scene, with this camera or another one; what is loaded is shared, not copied."""


def _check_frames(simulator: Simulator, frames: Any, count: int, channels: Channels) -> None:
    """Raise DeuxError unless these are as many frames, each with arrays of the camera's size and of their types."""
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
    for frame in frames:
        for name, shape, dtype in parts:
            array = getattr(frame, name)
            if not (isinstance(array, np.ndarray) and array.shape == shape and array.dtype == dtype):
                pixels = f"{camera.width} x {camera.height} pixels"
                right = f"an ndarray of {sizes(shape)}, {np.dtype(dtype)}, for its camera of {pixels}"
                raise broken_contract(simulator, f"a frame whose {name} is {kind_of(array)}", right, "render")
