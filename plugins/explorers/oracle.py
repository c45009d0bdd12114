"""The oracle explorer: it is given the true free floor and visits targets all over it by shortest paths."""

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
    """Visits targets spread evenly over the true free floor: a privileged bound for explorers that have to map it.

    The floor is divided into parts of equal area with one target at random in each. The robot goes to the nearest of
    those left, by the length of the path. When the last has been visited, new ones are drawn. It keeps no map: figures
    show what its frames saw, not the whole floor that it was given.

    Args:
        targets: number of targets. In generated flats the robot sees most of a flat within 250 steps with 8 of them,
            and within 500 steps with 12.
        safety_margin: metres that paths keep from obstacles beyond the robot's radius, where there is room for it.
        motion: "arcs", turns while it goes on, where there is room; or "turns", on the spot.
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
        # A path takes a diagonal step only where both cells beside it are free, so paths join what edges join.
        self._components, _ = ndimage.label(self._roomy)

    def act(self, observation: Observation) -> Action:
        """Go on towards the target, or to the next; a target on whose way the robot gets stuck is given up."""
        action = self._recovery.action(observation.pose, observation.collided)
        if action is not None:
            self._pursuit = None
            return action
        return self._go_on(observation.pose)

    def _go_on(self, pose: np.ndarray) -> Action:
        """The next action towards the present target or, where that has ended, towards the next."""
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
        """Take the nearest target off the list, which is drawn anew when it is empty."""
        if not self._targets:
            drawn = [self._rng.choice(part) for part in stratify(self._space.free, self._count)]
            self._targets = [(int(row), int(column)) for row, column in drawn]
        distance = distance_field(self._free_around(here), here)
        return self._targets.pop(int(np.argmin([distance[target] for target in self._targets])))

    def _floor(self, here: Cell, goal: Cell) -> np.ndarray:
        """Floor to plan on, rows x columns bool: the free floor, without its margins if a path leads through the rest.

        The margins are left in around the robot and the target, which may stand in them.
        """
        free, roomy = self._free_around(here), self._roomy.copy()
        for cell in (here, goal):
            window = _window(cell, self._margin)
            roomy[window] = free[window]
        return roomy if self._components_near(here, roomy) & self._components_near(goal, roomy) else free

    def _components_near(self, cell: Cell, roomy: np.ndarray) -> set[int]:
        """Numbers of the connected components of the floor without margins that a cell is connected to.

        Two cells that have one in common are connected; unlike a search for the path, this looks at a few cells only.
        """
        window = _window(cell, self._margin + 1)
        patches, _ = ndimage.label(roomy[window])
        patch = patches[cell[0] - window[0].start, cell[1] - window[1].start]
        return set(self._components[window][patches == patch].tolist()) - {0} if patch else set()

    def _free_around(self, here: Cell) -> np.ndarray:
        """The free floor and what is next to the robot, which may stand in a cell whose centre is too near a wall."""
        free = self._space.free.copy()
        window = _window(here, 1)
        free[window] |= self._space.clearance[window] > 0.0
        return free


def _window(cell: Cell, reach: int) -> tuple[slice, slice]:
    """The square of cells around a cell."""
    row, column = cell
    return np.s_[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
