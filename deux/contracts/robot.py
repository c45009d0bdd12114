"""The contract of a simulator: one robot in one scene, what it can do and what its camera records."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np

from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.geometry.robot import Robot


class Action(IntEnum):
    """What the robot can do in one step."""

    FORWARD = 0
    LEFT = 1
    RIGHT = 2
    STOP = 3


@dataclass(frozen=True)
class Frame:
    """What the robot's camera records at one pose.

    Args:
        rgb: H x W x 3 uint8.
        depth: H x W float32 in metres, 0 where the camera sees nothing within its range.
        pose: 4 x 4 float64, camera-to-world.
        labels: H x W int32, index into `Simulator.label_names`, -1 where nothing is labelled; None unless asked for.
    """

    rgb: np.ndarray
    depth: np.ndarray
    pose: np.ndarray
    labels: np.ndarray | None = None


class Simulator(Protocol):
    """One robot in one scene."""

    camera: Camera
    robot: Robot
    label_names: tuple[str, ...]

    def reset(self, x: float, z: float, yaw: float) -> None:
        """Put the robot on the floor at world (x, z), metres, heading `yaw` (radians, 0 looks along -Z)."""

    def step(self, action: Action) -> bool:
        """Carry out one action; true if the robot touched something and moved less than it was told to."""

    @property
    def pose(self) -> np.ndarray:
        """The camera's present camera-to-world matrix, 4 x 4 float64."""

    def observe(self, labels: bool = False) -> Frame:
        """Render what the camera sees now."""

    def depth(self) -> np.ndarray:
        """What `observe` would show as depth, H x W float32, without the cost of drawing colours."""

    def labelled_depth(self) -> tuple[np.ndarray, np.ndarray]:
        """As `depth`, and with it the labels of `observe(labels=True)`, H x W int32."""

    def free_space(self) -> FreeSpace:
        """The true free floor that is connected to the robot's main floor. Privileged: no agent sees it unasked."""
