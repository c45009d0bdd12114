"""The oracle explorer: it knows the true free floor, and visits targets all over it on shortest paths."""

import math

import numpy as np
from scipy import ndimage

from deux.contracts import Action, Episode, Explorer, Need, Observation
from deux.errors import DeuxError, check_range
from deux.geometry.stratify import stratify
from deux.mapping.navigation import Motion
from deux.mapping.planning import distance_field
from deux.mapping.pursuit import Pursuit, Target
from deux.mapping.recovery import Recovery

Cell = tuple[int, int]
"""(row, column) on the grid of the true floor."""


class OracleExplorer(Explorer):
    """Visits targets spread evenly over the true free floor: a privileged upper bound for explorers that build a map.

    The floor is divided into parts of equal area, with a random target in each. The robot always drives to the nearest
    remaining target, by path length, and draws new ones after the last. It keeps no map: figures show what its frames
    saw, not the given floor.

    Args:
        targets: number of targets. In generated flats, the robot sees most of a flat within 250 steps with 8 of them,
            and within 500 steps with 12.
        safety_margin: distance in metres that paths keep from obstacles if there is room, besides the robot's radius.
        motion: "arcs" for turning while moving, if there is room; or "turns" for turning on the spot.
    """

    needs = frozenset({Need.FREE_SPACE})

    def __init__(self, targets: int = 12, safety_margin: float = 0.05, motion: Motion = "arcs") -> None:
        if targets < 1:
            raise DeuxError(f"oracle's targets is {targets}: it must be at least 1.")
        if motion not in ("arcs", "turns"):
            raise DeuxError(f'explore.motion is "{motion}": it must be "arcs" or "turns".')
        check_range("explore.safety_margin", safety_margin, 0.0, 10.0)
        self._count = targets
        self._safety_margin = safety_margin
        self._motion = motion

    def reset(self, episode: Episode) -> None:
        """Begin an episode."""
        assert episode.free_space is not None
        self._space = episode.free_space
        self._robot = episode.robot
        self._rng = np.random.default_rng(episode.seed)
        self._recovery = Recovery(episode.robot, self._rng)
        self._targets: list[Cell] = []
        self._pursuit: Pursuit | None = None
        self._margin = math.ceil(self._safety_margin / self._space.frame.resolution) + 1
        self._roomy = self._space.free & (self._space.clearance >= self._robot.radius + self._safety_margin)
        # Paths step diagonally only between two free cells, so they connect exactly the 4-connected components.
        self._components, _ = ndimage.label(self._roomy)

    def act(self, observation: Observation) -> Action:
        """Move towards the target or the next one; a target is abandoned if the robot gets stuck on the way."""
        action = self._recovery.action(observation.pose, observation.collided)
        if action is not None:
            self._pursuit = None
            return action
        return self._pursue(observation.pose)

    def _pursue(self, pose: np.ndarray) -> Action:
        """The next action towards the current target or, if its pursuit has ended, the next one."""
        frame = self._space.frame
        here = frame.cell(pose[0, 3], pose[2, 3])
        for _ in range(self._count + 1):
            if self._pursuit is None:
                self._pursuit = Pursuit(
                    Target(frame.centre(*self._next_target(here))), self._robot, motion=self._motion
                )
            goal = frame.cell(*self._pursuit.target.place)
            action = self._pursuit.act(pose, self._floor(here, goal), frame)
            if action is not None:
                return action
            self._pursuit = None
        return self._recovery.turn_away()  # all targets are where the robot stands

    def _next_target(self, here: Cell) -> Cell:
        """Remove the nearest target from the list and return it; new ones are drawn if the list is empty."""
        if not self._targets:
            drawn = [self._rng.choice(part) for part in stratify(self._space.free, self._count)]
            self._targets = [(int(row), int(column)) for row, column in drawn]
        distance = distance_field(self._free_around(here), here)
        return self._targets.pop(int(np.argmin([distance[target] for target in self._targets])))

    def _floor(self, here: Cell, goal: Cell) -> np.ndarray:
        """The cells to plan on, rows x columns bool: the free floor without safety margins, if a path exists there.

        Around the robot and the target, which may be within the margins, the margins are included.
        """
        free, roomy = self._free_around(here), self._roomy.copy()
        for cell in (here, goal):
            window = _window(cell, self._margin)
            roomy[window] = free[window]
        return roomy if self._components_near(here, roomy) & self._components_near(goal, roomy) else free

    def _components_near(self, cell: Cell, roomy: np.ndarray) -> set[int]:
        """Labels of the connected components of the floor without margins to which a cell is connected.

        Cells with a common label are connected; unlike a path search, this reads only a few cells.
        """
        window = _window(cell, self._margin + 1)
        patches, _ = ndimage.label(roomy[window])
        patch = patches[cell[0] - window[0].start, cell[1] - window[1].start]
        return set(self._components[window][patches == patch].tolist()) - {0} if patch else set()

    def _free_around(self, here: Cell) -> np.ndarray:
        """The free floor and the cells next to the robot, whose own cell's centre may be too close to a wall."""
        free = self._space.free.copy()
        window = _window(here, 1)
        free[window] |= self._space.clearance[window] > 0.0
        return free


def _window(cell: Cell, reach: int) -> tuple[slice, slice]:
    """The square of cells around a cell."""
    row, column = cell
    return np.s_[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
