"""Recovery behaviours of a robot that is stuck, which use its poses and collisions, but no map."""

import math
from collections import deque
from collections.abc import Iterator
from itertools import repeat

import numpy as np

from deux.contracts import Action, Robot


class Recovery:
    """Detects that the robot is stuck, and then chooses its actions until it is free.

    A robot can be stuck in two ways, with a behaviour for each:

    - blocked: `most_failures` consecutive forward actions failed, not counting turns between them. The robot turns by a
      random angle of 30 to 180 degrees to either side and steps forward. One large turn gets it out of a corner, where
      random single turns would cancel out.
    - confined: it stayed within a square of side `extent` for `patience` steps, in which `most_confined` forward
      actions failed. It then searches the boundary for a gap: it moves forward as long as it can, sliding along
      obstacles, and turns by 20 degrees when it cannot, for a full circle to the left and then to the right, so that it
      slides along each wall from end to end. Random turns would find the same gap, but without any bound on the time.
      The search ends when the robot has left the square.

    A forward action has failed if an obstacle stopped it and the robot moved by less than `least_move` of a step; with
    the default, sliding along a wall is progress.

    Args:
        robot: provides the motion parameters.
        rng: source of randomness for the turns.
        most_failures: consecutive failed forward actions.
        most_confined: failed forward actions within `patience` steps; with 0, a robot that stays in one place is
            confined even without any collision.
        least_move: fraction of a step.
        extent: side of the square in metres.
        patience: number of steps.
    """

    def __init__(
        self,
        robot: Robot,
        rng: np.random.Generator,
        most_failures: int = 2,
        most_confined: int = 4,
        least_move: float = 0.25,
        extent: float = 0.6,
        patience: int = 40,
    ) -> None:
        self.failures = 0
        """Consecutive failed forward actions up to the last action; 0 if the last action did not fail."""
        self._rng = rng
        self._turn_angle = robot.turn_angle
        self._most_failures = most_failures
        self._most_confined = most_confined
        self._least_move = least_move * robot.forward_step
        self._least_slide = 0.1 * robot.forward_step
        self._extent = extent
        self._places: deque[np.ndarray] = deque(maxlen=patience + 1)
        self._failed: deque[bool] = deque(maxlen=patience + 1)
        self._in_a_row = 0
        self._moved = 0.0
        self._searching = False
        self._actions: Iterator[Action] = iter(())

    def action(self, pose: np.ndarray, collided: bool) -> Action | None:
        """The next recovery action; None while the robot is not stuck. Call it once before every step.

        Args:
            pose: 4 x 4 camera-to-world.
            collided: whether an obstacle stopped the last action early.
        """
        self._observe(pose[[0, 2], 3], collided)
        if self._searching and self._is_spread():
            self._searching, self._actions = False, iter(())
        if not self._searching and self._is_confined():
            self._searching, self._actions = True, self._search()
        elif not self._searching and self.failures >= self._most_failures:
            return self.turn_away()
        action = next(self._actions, None)
        if action is None and self._searching:
            self._searching = False
            self._places.clear()
            self._failed.clear()
        return action

    def turn_away(self, steps: int = 1) -> Action:
        """Start a random turn of 30 to 180 degrees, followed by `steps` forward steps; return the first action."""
        turn = Action.LEFT if self._rng.random() < 0.5 else Action.RIGHT
        turns = math.ceil(self._rng.uniform(30.0, 180.0) / self._turn_angle)
        self._actions = iter([turn] * turns + [Action.FORWARD] * steps)
        return next(self._actions)

    def _observe(self, place: np.ndarray, collided: bool) -> None:
        """Record whether the last action failed; `place` is the robot's new position, world (x, z)."""
        self._moved = float(np.hypot(*(place - self._places[-1]))) if self._places else 0.0
        failed = collided and self._moved < self._least_move
        if failed:
            self._in_a_row += 1
        elif self._moved >= self._least_move:
            self._in_a_row = 0
        self.failures = self._in_a_row if failed else 0
        self._places.append(place)
        self._failed.append(failed)

    def _is_spread(self) -> bool:
        """Whether the last positions do not fit into the square."""
        return bool(np.ptp(np.array(self._places), axis=0).max() > self._extent)

    def _is_confined(self) -> bool:
        full = len(self._places) == self._places.maxlen
        return full and sum(self._failed) >= self._most_confined and not self._is_spread()

    def _search(self) -> Iterator[Action]:
        """Move forward in every direction, for as long as the robot moves."""
        turns = math.ceil(20.0 / self._turn_angle)
        # A full circle, and a quarter more for the wall at which the search began.
        directions = math.ceil(450.0 / (turns * self._turn_angle))
        for turn in (Action.LEFT, Action.RIGHT):
            for _ in range(directions):
                yield Action.FORWARD
                while self._moved >= self._least_slide:
                    yield Action.FORWARD
                yield from repeat(turn, turns)
