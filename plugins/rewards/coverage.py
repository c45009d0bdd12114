"""Coverage: the growth of the known area."""

import numpy as np

from deux.contracts import Episode, Experience, Reward


class CoverageReward(Reward):
    """Square metres of the map, free or occupied, that became known by this step (coverage of exploring_exploration).

    The published agent multiplies it by 1e-3; here training normalises every reward by the spread of its returns.
    """

    def reset(self, episode: Episode) -> None:
        """Nothing is known."""
        self._known = 0

    def __call__(self, experience: Experience) -> float:
        """The growth in square metres; a cell that is known stays so, and growth is never negative."""
        before, self._known = self._known, int(np.count_nonzero(experience.occupancy))
        return (self._known - before) * experience.frame.resolution**2
