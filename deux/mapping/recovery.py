"""Recovery behaviours of a robot that is stuck; they take its own poses and contacts, and no map."""

import math
from collections import deque
from collections.abc import Iterator
from itertools import repeat

import numpy as np

from deux.contracts import Action, Robot


class Recovery:
    """Detects that the robot is stuck, and then chooses its actions until it is free.

    There are two behaviours, as a robot can be stuck in two ways:

    - blocked: `most_failures` forward actions in a row failed, turns left out. The robot turns by a random angle of 30
      to 180 degrees to either side and steps forward. One large turn gets it out of a corner; random single turns
      cancel out.
    - confined: for `patience` steps it stayed in a square with sides of `extent`, where `most_confined` forward actions
      failed. It searches the boundary of that place for a gap: it goes forward for as long as that moves it, sliding
      along what is in the way, and turns by 20 degrees where it does not, all round to the left and then to the right,
      so that it slides along each wall from end to end. Random turns find the same gap, but there is no limit to how
      long they may take. The search ends when the robot has left the square.

    A forward action failed if it was cut short by an obstacle and moved the robot by less than `least_move` of a step;
    with the default, sliding along a wall is progress.

    Args:
        robot: its motion.
        rng: where the random turns come from.
        most_failures: failed forward actions in a row.
        most_confined: failed forward actions within `patience` steps; with 0, a robot that stays in one place is
            confined even if it touches nothing.
        least_move: share of a step.
        extent: metres.
        patience: steps.
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
        """Forward actions in a row that failed, up to the last action; 0 if the last action was not one of them."""
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
        """The next action of the recovery; None while the robot is free. Ask once before every step.

        Args:
            pose: 4 x 4 camera-to-world.
            collided: whether the last action was cut short by an obstacle.
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
        """Begin a random turn of 30 to 180 degrees with so many steps forward after it; returns its first action."""
        turn = Action.LEFT if self._rng.random() < 0.5 else Action.RIGHT
        turns = math.ceil(self._rng.uniform(30.0, 180.0) / self._turn_angle)
        self._actions = iter([turn] * turns + [Action.FORWARD] * steps)
        return next(self._actions)

    def _observe(self, place: np.ndarray, collided: bool) -> None:
        """Record whether the last action failed; `place` is where it brought the robot, world (x, z)."""
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
        """Whether the last places do not fit into the square."""
        return bool(np.ptp(np.array(self._places), axis=0).max() > self._extent)

    def _is_confined(self) -> bool:
        full = len(self._places) == self._places.maxlen
        return full and sum(self._failed) >= self._most_confined and not self._is_spread()

    def _search(self) -> Iterator[Action]:
        """Forward in every direction, and on wherever that moved the robot."""
        turns = math.ceil(20.0 / self._turn_angle)
        # All round, and a quarter more for the wall at which it began and from which it turned away.
        directions = math.ceil(450.0 / (turns * self._turn_angle))
        for turn in (Action.LEFT, Action.RIGHT):
            for _ in range(directions):
                yield Action.FORWARD
                while self._moved >= self._least_slide:
                    yield Action.FORWARD
                yield from repeat(turn, turns)
