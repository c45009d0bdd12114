"""A reward for free floor that the robot sees for the first time, less the further away it is."""

import numpy as np

from deux.contracts import Episode, Experience, Reward
from deux.errors import check_range


class NewFloorReward(Reward):
    """Square metres of free floor seen for the first time, each weighted by exp(-distance / reach).

    Args:
        reach: metres from the robot at which a cell counts 1 / e of what it counts nearby.

    Raises:
        DeuxError: `reach` is not above 0.
    """

    def __init__(self, reach: float = 3.0) -> None:
        check_range("explorer_training.reward_options.reach", reach, 0.0, ends=False)
        self.reach = reach

    def reset(self, episode: Episode) -> None:
        """Nothing is kept between steps: the map itself counts the frames that saw each cell."""

    def __call__(self, experience: Experience) -> float:
        """The weighted area in square metres, not negative."""
        frame = experience.frame
        new = experience.seen & (experience.views == 1) & (experience.occupancy == 2)
        rows, columns = np.nonzero(new)
        x, _, z = experience.observation.pose[:3, 3]
        apart = np.hypot(
            frame.origin_x + (columns + 0.5) * frame.resolution - x,
            frame.origin_z + (rows + 0.5) * frame.resolution - z,
        )
        return float(np.exp(-apart / self.reach).sum() * frame.resolution**2)
