"""Getting a robot out of a place that holds it, with nothing but its own motion to go by."""

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from deux.contracts import Action, Robot


class WayOut:
    """Notices that a robot is held in one place, and searches the rim of that place for a way out.

    The robot is held when for `patience` steps it stayed in a square with sides of `extent` and touched something. It
    then pushes forward for as long as that moves it, sliding along what is in the way, and turns by 20 degrees where
    it does not, always to the same side: so it slides along each wall around it, from one end to the other. It does
    so to the left, then to the right, for ways out round a corner that lies there. The search ends when the robot has
    left the square. Random moves find the same way out, but there is no limit to how long they may take.

    Args:
        robot: its motion.
        extent: metres.
        patience: steps.
    """

    def __init__(self, robot: Robot, extent: float = 0.6, patience: int = 40) -> None:
        self._extent = extent
        self._least_move = 0.1 * robot.forward_step
        self._turns = math.ceil(20.0 / robot.turn_angle)
        # All round, and a quarter more for the wall at which it began and from which it turned away.
        self._directions = math.ceil(450.0 / (self._turns * robot.turn_angle))
        self._places: deque[np.ndarray] = deque(maxlen=patience + 1)
        self._touched: deque[bool] = deque(maxlen=patience + 1)
        self._search: Iterator[Action] | None = None
        self._moved = False

    def action(self, pose: np.ndarray, collided: bool) -> Action | None:
        """The search's next action; None while the robot is free to do as it likes. Ask once before every step.

        Args:
            pose: 4 x 4 camera-to-world.
            collided: whether the last action was cut short by an obstacle.
        """
        here = pose[[0, 2], 3]
        self._moved = len(self._places) > 0 and np.hypot(*(here - self._places[-1])) >= self._least_move
        self._places.append(here)
        self._touched.append(collided)
        if np.ptp(np.array(self._places), axis=0).max() > self._extent:
            self._search = None
        elif self._search is None and len(self._places) == self._places.maxlen and any(self._touched):
            self._search = self._pushes()
        if self._search is None:
            return None
        action = next(self._search, None)
        if action is None:
            self._search = None
            self._places.clear()
        return action

    def _pushes(self) -> Iterator[Action]:
        """Forward in every direction, and on wherever that moved the robot."""
        for turn in (Action.LEFT, Action.RIGHT):
            for _ in range(self._directions):
                yield Action.FORWARD
                while self._moved:
                    yield Action.FORWARD
                yield from [turn] * self._turns
