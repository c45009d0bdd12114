"""The contract of a reward: what a learned explorer is trained to maximise."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from deux.contracts.explorer import Episode, Need, Observation
from deux.geometry.grid import GridFrame


@dataclass(frozen=True)
class Experience:
    """The result of one step: the frame after an action, and the map that includes it.

    Args:
        observation: the robot's observation, with depth and whatever the reward declared in `needs`.
        action: the action that led here, an `Action`; None for the first observation of an episode.
        frame: position, size and resolution of the grids. They grow, so compare cells by their world coordinates.
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        views: rows x columns int32, the number of frames so far that observed each cell, this one included.
        seen: rows x columns bool, the cells that this frame observed.
        view: the policy's input, by name (`deux.environment.egocentric`).
    """

    observation: Observation
    action: int | None
    frame: GridFrame
    occupancy: np.ndarray
    views: np.ndarray
    seen: np.ndarray
    view: Mapping[str, np.ndarray]


class Reward(ABC):
    """Computes the reward of each step. All options are in the constructor; each environment has its own instance."""

    needs: frozenset[Need] = frozenset()
    """What the observations must contain besides the sensor's depth: `Need.LABELS` or nothing."""

    @abstractmethod
    def reset(self, episode: Episode) -> None:
        """Begin an episode."""

    @abstractmethod
    def __call__(self, experience: Experience) -> float:
        """Compute the reward of a step; also called for an episode's first observation, whose value is ignored."""

    def state(self) -> dict[str, np.ndarray]:
        """The reward's learned state by name; empty if it learns nothing."""
        return {}

    def load_state(self, state: Mapping[str, np.ndarray]) -> None:  # noqa: B027
        """Restore what `state` returned; does nothing for a reward that learns nothing."""
