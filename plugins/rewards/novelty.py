"""Novelty reward: for places where the robot has rarely been."""

import math
from collections import Counter

from deux.contracts import Episode, Experience, Reward
from deux.errors import DeuxError


class NoveltyReward(Reward):
    """1 / sqrt(N), where N is the number of steps of this episode in the robot's cell, including this step.

    Args:
        cell: edge of a cell of the floor in metres; 0.5 in exploring_exploration.
    """

    def __init__(self, cell: float = 0.5) -> None:
        if not cell > 0.0:
            raise DeuxError(f"novelty's cell is {cell}: it must be above 0 (metres).")
        self._cell = cell

    def reset(self, episode: Episode) -> None:
        """Begin an episode without visited cells."""
        self._visits: Counter[tuple[int, int]] = Counter()

    def __call__(self, experience: Experience) -> float:
        """The reward; it is 1 for the first visit."""
        x, z = experience.observation.pose[[0, 2], 3]
        place = math.floor(x / self._cell), math.floor(z / self._cell)
        self._visits[place] += 1
        return 1.0 / math.sqrt(self._visits[place])
