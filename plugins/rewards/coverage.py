"""Coverage rewards: parts of the floor that come into view for the first time, or that have seldom been in view."""

import numpy as np

from deux.contracts import Episode, Experience, Reward


class CoverageReward(Reward):
    """Square metres of the map, free or occupied, that became known by this step (coverage of exploring_exploration).

    The published agent multiplies it by 1e-3; here training normalises every reward by the spread of its returns.
    """

    def reset(self, episode: Episode) -> None:
        """Begin an episode: nothing is known."""
        self._known = 0

    def __call__(self, experience: Experience) -> float:
        """The growth in square metres; a cell that is known stays so, and growth is never negative."""
        before, self._known = self._known, int(np.count_nonzero(experience.occupancy))
        return (self._known - before) * experience.frame.resolution**2


class SmoothCoverageReward(Reward):
    """The mean, over the map's cells that this frame shows, of 1 / sqrt(frames that have shown the cell).

    Each frame counts before it is judged, so that a frame of nothing but new cells is worth 1.
    """

    def reset(self, episode: Episode) -> None:
        """Begin an episode; the frames of each cell are counted by its map."""

    def __call__(self, experience: Experience) -> float:
        """The mean; 0 for a frame that shows nothing."""
        views = experience.views[experience.seen]
        return float(np.mean(1.0 / np.sqrt(views))) if len(views) else 0.0
