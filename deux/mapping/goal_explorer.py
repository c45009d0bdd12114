"""What explorers that keep a map and go from target to target have in common."""

import math
from abc import abstractmethod

import numpy as np

from deux.contracts import Action, Episode, Explorer, ExplorerMap, Observation
from deux.mapping.frontier_targets import FrontierCandidates, frontier_candidates, frontier_target
from deux.mapping.navigation import EscapeMoves
from deux.mapping.occupancy import EXACT, DepthErrors, OccupancyMap
from deux.mapping.planning import distance_field
from deux.mapping.pursuit import Point, Pursuit, Target
from deux.mapping.traversable import process_map


class GoalExplorer(Explorer):
    """Maps what it sees, chooses a target, goes there, and chooses the next: the loop of Algorithm 1.

    A subclass says which depth image the map is built from and how a target is chosen. The robot frees itself by
    random moves when it is stuck, when there is nowhere to go, and when the map walls it in.

    Args:
        resolution: edge of a map cell in metres.
        max_range: distance along the floor in metres up to which depth enters the map.
        safety_margin: metres that paths keep from obstacles beyond the robot's radius.
        unknown_traversable: whether paths may lead through the unknown.
        errors: how wrong the depth may be that the map is built from.
    """

    frontier_reach = 0.3
    """Metres from a frontier cell within which the robot may stop to look at it."""

    min_frontier = 6
    """Cells that a frontier must have; smaller ones are gaps between pixels."""

    least_area = 3.0
    """Square metres of floor within reach, with no frontier on it, below which the map counts as wrong.

    It is about the blind zone around a robot whose depth makes obstacles of all the floor that its camera sees.
    """

    escape_distance = 1.0
    """Metres that the robot tries to go straight on where the map walls it in."""

    def __init__(
        self,
        resolution: float,
        max_range: float,
        safety_margin: float,
        unknown_traversable: bool,
        errors: DepthErrors = EXACT,
    ) -> None:
        self._resolution = resolution
        self._max_range = max_range
        self._safety_margin = safety_margin
        self._unknown_traversable = unknown_traversable
        self._errors = errors

    @abstractmethod
    def map_depth(self, observation: Observation) -> np.ndarray:
        """The H x W depth image that the map is built from."""

    @abstractmethod
    def choose_target(self, pose: np.ndarray, candidates: FrontierCandidates, distance: np.ndarray) -> Target | None:
        """The next target, or None if there is nowhere to go.

        Args:
            pose: 4 x 4, the camera's present camera-to-world matrix.
            candidates: the frontier cells that can be reached; may be none.
            distance: rows x columns float64 over `self.occupancy.frame`: path length from the robot in cells, inf
                where it cannot go.
        """

    def target_is_stale(self, target: Target) -> bool:
        """Whether the target is no longer worth going to; asked before each action."""
        return False

    def reset(self, episode: Episode) -> None:
        """Forget everything and begin an episode."""
        self.rng = np.random.default_rng(episode.seed)
        self.robot = episode.robot
        self.occupancy = OccupancyMap(episode.camera, episode.robot, self._resolution, self._max_range, self._errors)
        self._escape = EscapeMoves(episode.robot, self.rng)
        self._pursuit: Pursuit | None = None
        self._last_pose: np.ndarray | None = None
        self._last_action: Action | None = None
        self._steps_stuck = 0
        self.frontier: Point | None = None
        self._finished: list[Point] = []

    def act(self, observation: Observation) -> Action:
        """Map what is seen, then go on towards the target."""
        self.occupancy.update(self.map_depth(observation), observation.pose)
        self._notice_contact(observation.pose)
        action = self._escape.next() if self._escape.active else self._go_on(observation.pose)
        self._last_pose, self._last_action = observation.pose, action
        return action

    def map(self) -> ExplorerMap | None:
        """The occupancy map as it stands; None before the first step."""
        if self.occupancy.cells.size == 0:
            return None
        return ExplorerMap(self.occupancy.frame, self.occupancy.cells.copy())

    def frontiers(self, distance: np.ndarray) -> FrontierCandidates:
        """The frontier cells that can be reached, without those that were targets before.

        What is still a frontier after the robot went there, or failed to, cannot be resolved: without this it would
        be chosen for ever.
        """
        return frontier_candidates(
            self.occupancy.cells,
            self.occupancy.frame,
            distance,
            self.min_frontier,
            self.frontier_reach,
            self._finished,
        )

    def frontier_target(self, candidates: FrontierCandidates, index: int) -> Target:
        """The target for one of the candidates; remembers its frontier cell as `self.frontier`."""
        cell, place = candidates.cells[index], candidates.places[index]
        self.frontier = self.occupancy.frame.centre(float(cell[0]), float(cell[1]))
        return frontier_target(self.occupancy.cells, self.occupancy.frame, cell, place, self.frontier_reach)

    def free_places(self, distance: np.ndarray, count: int) -> np.ndarray:
        """Up to `count` cells drawn from those that can be reached, N x 2 (row, column); there is at least one."""
        reachable = np.argwhere(np.isfinite(distance))
        return self.rng.choice(reachable, min(count, len(reachable)), replace=False)

    def _notice_contact(self, pose: np.ndarray) -> None:
        """Map what stopped the robot; start to free it after two forward actions in a row that moved nothing.

        Sliding along a wall is progress. The pose tells it, not `collided`, which is true for both.
        """
        if self._last_action is not Action.FORWARD or self._last_pose is None:
            return
        moved = float(np.hypot(*(pose[[0, 2], 3] - self._last_pose[[0, 2], 3])))
        if moved > 0.25 * self.robot.forward_step:
            self._steps_stuck = 0
            return
        self.occupancy.mark_contact(pose)
        self._steps_stuck += 1
        if self._steps_stuck >= 2:
            self._steps_stuck = 0
            self._escape.start()

    def _go_on(self, pose: np.ndarray) -> Action:
        """The next action towards the present target or, where that has ended, a new one; random if none leads on."""
        frame = self.occupancy.frame
        here = frame.cell(pose[0, 3], pose[2, 3])
        traversable = self._traversable(here)
        distance: np.ndarray | None = None
        for _ in range(3):
            if self._pursuit is None or self.target_is_stale(self._pursuit.target):
                distance = distance_field(traversable, here) if distance is None else distance
                self.frontier = None
                target = self._next_target(pose, distance)
                if target is None:
                    break
                self._pursuit = Pursuit(target, self.robot)
            action = self._pursuit.act(pose, traversable, frame)
            if action is not None:
                return action
            if self.frontier is not None:
                self._finished.append(self.frontier)
            self._pursuit = None
        return self._escape.next()

    def _next_target(self, pose: np.ndarray, distance: np.ndarray) -> Target | None:
        """The subclass's choice; None where the map walls the robot in, which then starts random moves.

        Among the few places that such a map leaves the robot would wander for ever. Random moves, "unstuck" in
        Algorithm 1, test the map: floor driven over is free whatever the depth said, and only what the body meets
        stays an obstacle.
        """
        candidates = self.frontiers(distance)
        reachable = np.count_nonzero(np.isfinite(distance)) * self._resolution**2
        if len(candidates) == 0 and reachable < self.least_area:
            self._escape.start(steps=math.ceil(self.escape_distance / self.robot.forward_step))
            return None
        return self.choose_target(pose, candidates, distance)

    def _traversable(self, here: tuple[int, int]) -> np.ndarray:
        clearance = (self.robot.radius + self._safety_margin) / self._resolution
        return process_map(self.occupancy.cells, clearance, [here], self._unknown_traversable)
