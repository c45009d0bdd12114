"""Coverage rewards: for parts of the floor that are seen for the first time, or that have rarely been seen."""

import numpy as np

from deux.contracts import Episode, Experience, Reward


class CoverageReward(Reward):
    """Square metres of the map that became known in this step, free or occupied (coverage of exploring_exploration).

    The published agent scales it by 1e-3; here training normalises every reward by the standard deviation of returns.
    """

    def reset(self, episode: Episode) -> None:
        """Begin an episode with an unknown map."""
        self._known = 0

    def __call__(self, experience: Experience) -> float:
        """The increase in square metres, which is never negative."""
        before, self._known = self._known, int(np.count_nonzero(experience.occupancy))
        return (self._known - before) * experience.frame.resolution**2


class SmoothCoverageReward(Reward):
    """The mean of 1 / sqrt(N) over the cells that this frame shows, where N frames have shown the cell.

    N includes this frame, so that the reward of a frame with only new cells is 1.
    """

    def reset(self, episode: Episode) -> None:
        """Begin an episode; the explorer's map counts the frames of each cell."""

    def __call__(self, experience: Experience) -> float:
        """The mean; 0 for a frame that shows no cells."""
        views = experience.views[experience.seen]
        return float(np.mean(1.0 / np.sqrt(views))) if len(views) else 0.0
