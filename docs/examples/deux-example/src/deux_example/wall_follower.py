"""An explorer that keeps a wall on its right."""

import numpy as np

from deux.contracts import Action, Episode, Explorer, Need, Observation


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
        self._random = np.random.default_rng(episode.seed)
        self._turns_left = 0
        self._went_forward = False

    def act(self, observation: Observation) -> Action:
        """Turn away from what is ahead, turn right where the wall ends, and go forward otherwise."""
        assert observation.sensor_depth is not None
        left, ahead, right = (_nearest(part) for part in np.array_split(observation.sensor_depth, 3, axis=1))
        if observation.collided:  # a corner that the camera did not see: turn by a random amount
            self._turns_left = int(self._random.integers(3, 10))
        if self._turns_left or min(ahead, left) < self.distance:
            self._turns_left = max(0, self._turns_left - 1)
            return self._choose(Action.LEFT)
        if right > 2 * self.distance and self._went_forward:
            return self._choose(Action.RIGHT)
        return self._choose(Action.FORWARD)

    def _choose(self, action: Action) -> Action:
        self._went_forward = action is Action.FORWARD
        return action


def _nearest(depth: np.ndarray) -> float:
    """The nearest depth in metres in the middle rows, where neither floor nor ceiling is near; inf if none is seen."""
    rows = len(depth)
    middle = depth[rows // 3 : rows - rows // 3]
    return float(middle[middle > 0].min(initial=np.inf))
