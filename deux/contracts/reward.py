"""The contract of a reward: what a learned explorer is trained to seek."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from deux.contracts.explorer import Episode, Need, Observation
from deux.geometry.grid import GridFrame


@dataclass(frozen=True)
class Experience:
    """What one look brought: the frame after an action, and what the robot then knows.

    Args:
        observation: what the robot sees now; it carries what the reward declared in `needs`, besides the depth.
        action: the action that led here, an `Action`; None at the first look of an episode.
        frame: where the grids lie; they grow, so cells are compared by their world coordinates.
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        views: rows x columns int32, the number of frames that told something about each cell, this one included.
        seen: rows x columns bool, the cells that this frame told something about.
        view: what the policy sees, by name (`deux.environment.egocentric`).
    """

    observation: Observation
    action: int | None
    frame: GridFrame
    occupancy: np.ndarray
    views: np.ndarray
    seen: np.ndarray
    view: Mapping[str, np.ndarray]


class Reward(ABC):
    """What one step is worth. All options are in the constructor; one instance serves one environment."""

    needs: frozenset[Need] = frozenset()
    """What the observations must carry besides the sensor's depth: `Need.LABELS` or nothing."""

    @abstractmethod
    def reset(self, episode: Episode) -> None:
        """Begin an episode."""

    @abstractmethod
    def __call__(self, experience: Experience) -> float:
        """The reward for coming here; also called for an episode's first look, where the value is not used."""

    def state(self) -> dict[str, np.ndarray]:
        """What the reward learned in training, by name; empty for a reward that learns nothing."""
        return {}

    def load_state(self, state: Mapping[str, np.ndarray]) -> None:  # noqa: B027
        """Take up what `state` returned; nothing to do for a reward that learns nothing."""
