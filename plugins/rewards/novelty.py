"""Novelty reward: places where the robot has seldom been."""

import math
from collections import Counter

from deux.contracts import Episode, Experience, Reward
from deux.errors import DeuxError


class NoveltyReward(Reward):
    """1 / sqrt(N), where N counts the steps that this episode has spent in the robot's cell, this one included.

    Args:
        cell: edge of a cell of the floor in metres; 0.5 in exploring_exploration.
    """

    def __init__(self, cell: float = 0.5) -> None:
        if not cell > 0.0:
            raise DeuxError(f"novelty's cell is {cell}: an edge in metres, more than 0, is right.")
        self._cell = cell

    def reset(self, episode: Episode) -> None:
        """Begin an episode: no cell was visited."""
        self._visits: Counter[tuple[int, int]] = Counter()

    def __call__(self, experience: Experience) -> float:
        """The reward; this visit is counted, so that the first one is worth 1."""
        x, z = experience.observation.pose[[0, 2], 3]
        place = math.floor(x / self._cell), math.floor(z / self._cell)
        self._visits[place] += 1
        return 1.0 / math.sqrt(self._visits[place])
