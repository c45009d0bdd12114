"""The contract of an explorer: what it sees, and that it chooses the robot's next action."""

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
    """What an explorer may ask the collector for, beyond the pose and the colour image."""

    SENSOR_DEPTH = "sensor_depth"
    PREDICTED_DEPTH = "predicted_depth"
    RESIDUAL = "residual"
    LABELS = "labels"
    FREE_SPACE = "free_space"


@dataclass(frozen=True)
class Episode:
    """What an explorer is told once, before its first step in a scene.

    Args:
        seed: seed of everything random in the explorer; the same seed gives the same actions.
        steps: number of actions that the episode lasts.
        camera: the robot's camera.
        robot: the robot's body and motion.
        free_space: the true free floor; None unless the explorer declared `Need.FREE_SPACE`.
        label_names: what the numbers in `Observation.labels` stand for; empty unless it declared `Need.LABELS`.
        floor: the floor of the scene on which it takes place, an index into `Simulator.floors`; 0 is the main floor.
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
    """What an explorer sees before each action. What it did not declare in `needs` is None.

    Args:
        step: 0 before the first action.
        pose: 4 x 4 float64, the camera's camera-to-world matrix.
        collided: whether the last action was cut short by an obstacle.
        rgb: H x W x 3 uint8.
        sensor_depth: H x W float32, metres, 0 = none.
        predicted_depth: H x W float32, metres: the depth model's output for this frame, corrected by its sparse points
            where `collect.correct_depth` asks for it.
        residual: H x W float32, not negative, the uncertainty of each pixel by the measure that `collect.uncertainty`
            chooses (an `Uncertainty`), the paper's being the mean absolute photometric error of both reconstructions
            of this frame, images in [0, 1]. NaN where the measure has no value, all NaN before the third frame.
        uncertainty: delta of Eq. 8 in [0, 1], the residual as one number; NaN where the residual has no values.
            Comes with `residual`.
        depth_error: median relative error of the predicted depth at the frame's sparse points, before any correction;
            NaN without points. Comes with `predicted_depth`.
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
    """What an explorer knows of the floor, for figures.

    Args:
        frame: where the grids lie.
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        uncertainty: rows x columns float32, the explorer's uncertainty field, NaN where it has none; or None.
        target: world x and z in metres of the place that it is on its way to; None if there is none.
    """

    frame: GridFrame
    occupancy: np.ndarray
    uncertainty: np.ndarray | None = None
    target: tuple[float, float] | None = None


class Explorer(ABC):
    """Decides where the robot goes. One instance explores one scene at a time; all options are in the constructor."""

    needs: frozenset[Need] = frozenset()
    """What each observation must carry. May be set in the constructor where it depends on the options."""

    @abstractmethod
    def reset(self, episode: Episode) -> None:
        """Forget everything and begin an episode."""

    @abstractmethod
    def act(self, observation: Observation) -> Action:
        """Choose the next action. `Action.STOP` ends the episode before its time."""

    def fingerprint(self) -> str | None:
        """What besides the options decides how the explorer acts, such as the hash of a weights file; or None.

        Frames that were collected with another fingerprint are not used again.
        """
        return None

    def map(self) -> ExplorerMap | None:
        """The map as it stands, for figures; None if the explorer keeps none."""
        return None


class FreeViewpoints(Explorer):
    """In place of an explorer: the frames come from free poses over the training scenes, and no robot acts.

    Each has ideal source frames, chosen by true depth. It is a ceiling for explorers, not one of them: what asks for
    actions refuses it.
    """

    def reset(self, episode: Episode) -> None:
        """Refuse: there is no episode."""
        raise DeuxError(NO_ROBOT)

    def act(self, observation: Observation) -> Action:
        """Refuse: there is no robot."""
        raise DeuxError(NO_ROBOT)


NO_ROBOT = (
    "free viewpoints are a ceiling and no explorer that acts, so that only task=experiment, task=train and "
    "task=collect take them: choose another explorer."
)
"""Why free viewpoints are refused."""
