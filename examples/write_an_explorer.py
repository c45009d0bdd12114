"""An explorer of your own: python examples/write_an_explorer.py [option=value ...]; docs/plugins.md packages it."""

import sys

import numpy as np

from deux.__main__ import main
from deux.contracts import Action, Episode, Explorer, Need, Observation
from deux.mapping.recovery import Recovery
from deux.registry import registry


class Bouncer(Explorer):
    """Walks on until something is nearer than `distance` metres, then turns by a random number of steps."""

    needs = frozenset({Need.SENSOR_DEPTH})

    def __init__(self, distance: float = 0.6) -> None:
        self.distance = distance

    def reset(self, episode: Episode) -> None:
        """Begin an episode: all that is random comes from its seed."""
        self.random, self.turns = np.random.default_rng(episode.seed), 0
        self.recovery = Recovery(episode.robot, self.random, most_confined=0)

    def act(self, observation: Observation) -> Action:
        """Go on, or turn; where the robot is stuck, `Recovery` frees it."""
        depth = observation.sensor_depth[len(observation.sensor_depth) // 3 :]
        if self.turns == 0 and depth[depth > 0].min(initial=np.inf) < self.distance:
            self.turns = int(self.random.integers(4, 15))
        self.turns = max(0, self.turns - 1)
        freeing = self.recovery.action(observation.pose, observation.collided)
        return (Action.LEFT if self.turns else Action.FORWARD) if freeing is None else freeing


if __name__ == "__main__":
    registry().register("explorers", "bouncer", Bouncer)
    sys.argv[1:] = ["explore=bouncer", "task=collect", *sys.argv[1:]]
    sys.exit(main())
