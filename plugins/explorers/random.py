"""The random explorer: the baseline, and the agent whose frames train the seed model."""

import math

import numpy as np

from deux.contracts import Action, Episode, Explorer, Observation
from deux.errors import DeuxError
from deux.mapping.recovery import Recovery


class RandomExplorer(Explorer):
    """Chooses forward, left or right at random, and recovers after a collision (Sec. IV.A of the paper).

    After a collision, it turns by 30 to 180 degrees to a random side and steps forward; if it does not leave a place
    within 40 steps that way, it searches the place's boundary for a gap (`deux.mapping.recovery`). With the paper's
    uniform choice, two thirds of the actions turn on the spot and the frames cover little; a higher
    `forward_probability` gives frames with more parallax.

    Args:
        forward_probability: probability of a step forward; 1/3 is uniform over the three actions.
    """

    def __init__(self, forward_probability: float = 1.0 / 3.0) -> None:
        if not 0.0 <= forward_probability <= 1.0:
            raise DeuxError(f"random's forward_probability is {forward_probability}: it must be between 0 and 1.")
        self._forward_probability = forward_probability

    def reset(self, episode: Episode) -> None:
        """Begin an episode."""
        self._rng = np.random.default_rng(episode.seed)
        # Any collision makes it turn away, even if it slides along a wall.
        self._recovery = Recovery(episode.robot, self._rng, most_failures=1, most_confined=1, least_move=math.inf)

    def act(self, observation: Observation) -> Action:
        """Choose a random action, or the recovery's."""
        action = self._recovery.action(observation.pose, observation.collided)
        if action is not None:
            return action
        if self._rng.random() < self._forward_probability:
            return Action.FORWARD
        return Action.LEFT if self._rng.random() < 0.5 else Action.RIGHT
