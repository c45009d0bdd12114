"""The contract of an explorer: it receives observations and chooses the robot's actions."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from deux.contracts.simulator import Action
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace, GridFrame
from deux.geometry.robot import Robot


class Need(StrEnum):
    """What an explorer may request from the collector besides the pose and the colour image."""

    SENSOR_DEPTH = "sensor_depth"
    PREDICTED_DEPTH = "predicted_depth"
    RESIDUAL = "residual"
    LABELS = "labels"
    FREE_SPACE = "free_space"


@dataclass(frozen=True)
class Episode:
    """What an explorer receives once, before its first step in a scene.

    Args:
        seed: random seed of the explorer; the same seed gives the same actions.
        steps: length of the episode, in actions.
        camera: the robot's camera.
        robot: the robot's body and motion.
        free_space: the true free floor; None unless the explorer declared `Need.FREE_SPACE`.
        label_names: names of the classes that `Observation.labels` indexes; empty unless it declared `Need.LABELS`.
        floor: the floor that is explored, an index into `Simulator.floors`; 0 is the main floor.
    """

    seed: int
    steps: int
    camera: Camera
    robot: Robot
    free_space: FreeSpace | None = None
    label_names: tuple[str, ...] = ()
    floor: int = 0


@dataclass(frozen=True)
class Observation:
    """What an explorer receives before each action. Fields that it did not declare in `needs` are None.

    Args:
        step: 0 before the first action.
        pose: 4 x 4 float64, the camera's camera-to-world matrix.
        collided: whether the last action was cut short by an obstacle.
        rgb: H x W x 3 uint8.
        sensor_depth: H x W float32, metres, 0 = none.
        predicted_depth: H x W float32, metres: the depth model's output for this frame, corrected by its sparse points
            if `collect.correct_depth` is set.
        residual: H x W float32, not negative: the uncertainty of each pixel, by the measure `collect.uncertainty` (an
            `Uncertainty`). The paper's is the mean absolute photometric error of both reconstructions of this frame,
            with images in [0, 1]. NaN where the measure has no value; all NaN before the third frame.
        uncertainty: delta of Eq. 8 in [0, 1], the residual reduced to one number; NaN if the residual is all NaN. Set
            together with `residual`.
        depth_error: median relative error of the predicted depth at the frame's sparse points, before any correction;
            NaN without points. Set together with `predicted_depth`.
        labels: H x W int32, -1 = unlabelled.
    """

    step: int
    pose: np.ndarray
    collided: bool
    rgb: np.ndarray
    sensor_depth: np.ndarray | None = None
    predicted_depth: np.ndarray | None = None
    residual: np.ndarray | None = None
    uncertainty: float | None = None
    depth_error: float | None = None
    labels: np.ndarray | None = None


@dataclass(frozen=True)
class ExplorerMap:
    """An explorer's map of the floor, for figures.

    Args:
        frame: position, size and resolution of the grids.
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        uncertainty: rows x columns float32, the explorer's uncertainty field, NaN where it has no value; or None.
        target: world x and z in metres of the current goal; None without one.
    """

    frame: GridFrame
    occupancy: np.ndarray
    uncertainty: np.ndarray | None = None
    target: tuple[float, float] | None = None


class Explorer(ABC):
    """Decides where the robot goes. One instance explores one scene at a time; all options are in the constructor."""

    needs: frozenset[Need] = frozenset()
    """What each observation must contain. Set it in the constructor if it depends on the options."""

    @abstractmethod
    def reset(self, episode: Episode) -> None:
        """Begin an episode, with no state left from an earlier one."""

    @abstractmethod
    def act(self, observation: Observation) -> Action:
        """Choose the next action. `Action.STOP` ends the episode early."""

    def fingerprint(self) -> str | None:
        """Whatever determines the explorer's actions besides its options, such as the hash of a weights file; or None.

        A dataset is reused only by an explorer with the same fingerprint.
        """
        return None

    def map(self) -> ExplorerMap | None:
        """The current map, for figures; None if the explorer keeps none."""
        return None


class FreeViewpoints(Explorer):
    """An upper bound for explorers: frames from free camera poses all over the training scenes, without a robot.

    Each frame has ideal source frames, chosen by true depth. It is chosen like an explorer, but has no actions: any
    component that asks for them raises an error.
    """

    def reset(self, episode: Episode) -> None:
        """Raise DeuxError: there is no episode."""
        raise DeuxError(NO_ROBOT)

    def act(self, observation: Observation) -> Action:
        """Raise DeuxError: there is no robot."""
        raise DeuxError(NO_ROBOT)


NO_ROBOT = (
    "free viewpoints are a ceiling for explorers and choose no actions, so only task=experiment, task=train and "
    "task=collect accept them: choose another explorer."
)
"""The error message of components that need a robot's actions."""
