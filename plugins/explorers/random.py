"""The random explorer: the simplest baseline, and the agent whose frames train the seed model."""

import numpy as np

from deux.contracts import Action, Episode, Explorer, Observation
from deux.errors import DeuxError
from deux.mapping.navigation import EscapeMoves
from deux.mapping.way_out import WayOut


class RandomExplorer(Explorer):
    """Draws forward, left and right at random; frees itself after a collision (Sec. IV.A of the paper).

    After a collision it turns by a random amount, 30 to 180 degrees, to one side and takes a step; where that does not
    get it away from a place in 40 steps, it searches the place for a way out (`WayOut`). Turns are drawn left and right
    with equal probability, so with the published uniform draw two thirds of the actions turn on the spot and the frames
    cover little; a higher `forward_probability` gives frames with more parallax.

    Args:
        forward_probability: probability of going forward; 1/3 is uniform over the three moves.
    """

    def __init__(self, forward_probability: float = 1.0 / 3.0) -> None:
        if not 0.0 <= forward_probability <= 1.0:
            raise DeuxError(
                f"random's forward_probability is {forward_probability}: a probability between 0 and 1 is right."
            )
        self._forward_probability = forward_probability

    def reset(self, episode: Episode) -> None:
        """Begin an episode."""
        self._rng = np.random.default_rng(episode.seed)
        self._escape = EscapeMoves(episode.robot, self._rng)
        self._way_out = WayOut(episode.robot)

    def act(self, observation: Observation) -> Action:
        """Draw the next action, unless the robot is held and there is a way out to be found."""
        searching = self._way_out.action(observation.pose, observation.collided)
        if searching is not None:
            return searching
        if observation.collided:
            self._escape.start()
        if self._escape.active:
            return self._escape.next()
        if self._rng.random() < self._forward_probability:
            return Action.FORWARD
        return Action.LEFT if self._rng.random() < 0.5 else Action.RIGHT
