"""Smooth coverage: parts of the map that have seldom been seen."""

import numpy as np

from deux.contracts import Episode, Experience, Reward


class SmoothCoverageReward(Reward):
    """The mean, over the map's cells that this frame shows, of 1 / sqrt(frames that have shown the cell).

    Each frame counts before it is judged, so that a frame of nothing but new cells is worth 1.
    """

    def reset(self, episode: Episode) -> None:
        """The map does the counting."""

    def __call__(self, experience: Experience) -> float:
        """0 for a frame that shows nothing."""
        views = experience.views[experience.seen]
        return float(np.mean(1.0 / np.sqrt(views))) if len(views) else 0.0
