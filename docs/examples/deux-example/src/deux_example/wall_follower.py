"""An explorer that keeps a wall on its right."""

import numpy as np

from deux.contracts import Action, Episode, Explorer, Need, Observation
from deux.mapping.recovery import Recovery


class WallFollower(Explorer):
    """Walks along the walls of a room with the wall on its right, by what the depth sensor sees.

    Args:
        distance: metres that it keeps from what stands ahead, and within which it counts something on its right as
            the wall.
    """

    needs = frozenset({Need.SENSOR_DEPTH})

    def __init__(self, distance: float = 0.75) -> None:
        self.distance = distance

    def reset(self, episode: Episode) -> None:
        """Begin an episode."""
        # A dead end, where there are walls on all sides, would make it turn for ever.
        self._recovery = Recovery(episode.robot, np.random.default_rng(episode.seed), most_confined=0)
        self._went_forward = False

    def act(self, observation: Observation) -> Action:
        """Follow the wall, but for the moves that free the robot where it is stuck."""
        assert observation.sensor_depth is not None
        action = self._recovery.action(observation.pose, observation.collided)
        if action is None:
            action = self._follow(observation.sensor_depth)
        self._went_forward = action is Action.FORWARD
        return action

    def _follow(self, depth: np.ndarray) -> Action:
        """Turn away from what is ahead, turn right where the wall ends, and go forward otherwise."""
        left, ahead, right = (_nearest(part) for part in np.array_split(depth, 3, axis=1))
        if min(ahead, left) < self.distance:
            return Action.LEFT
        if right > 2 * self.distance and self._went_forward:
            return Action.RIGHT
        return Action.FORWARD


def _nearest(depth: np.ndarray) -> float:
    """The nearest depth in metres in the middle rows, where neither floor nor ceiling is near; inf if none is seen."""
    rows = len(depth)
    middle = depth[rows // 3 : rows - rows // 3]
    return float(middle[middle > 0].min(initial=np.inf))
