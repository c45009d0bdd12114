"""Base class of the explorers that keep an occupancy map and go from target to target (Algorithm 1)."""

import math
from abc import abstractmethod
from collections import deque
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from deux.contracts import Action, Episode, Explorer, ExplorerMap, Need, Observation
from deux.errors import DeuxError, check_range
from deux.mapping.action_costs import action_costs
from deux.mapping.finished_frontiers import FinishedFrontiers
from deux.mapping.frontier_targets import FrontierCandidates, cell_centres, frontier_candidates, frontier_target
from deux.mapping.navigation import Motion
from deux.mapping.occupancy import EXACT, OCCUPIED, PREDICTED, OccupancyMap
from deux.mapping.planning import distance_field
from deux.mapping.pursuit import Point, Pursuit, Target
from deux.mapping.recovery import Recovery
from deux.mapping.traversable import process_map

DepthSource = Literal["predicted", "sensor"]


@dataclass(frozen=True)
class Reach:
    """What the robot can reach on its map.

    Args:
        clearance: radius in cells by which obstacles are dilated.
        distance: rows x columns float64, path length from the robot in cells, inf if unreachable.
        candidates: the reachable frontier cells.
    """

    clearance: float
    distance: np.ndarray
    candidates: FrontierCandidates


class GoalExplorer(Explorer):
    """Builds a map, chooses a target, drives there and chooses the next: the loop of Algorithm 1.

    Subclasses choose the targets. A robot that is stuck frees itself (`deux.mapping.recovery`); if there is no target,
    or the map confines the robot, it moves randomly.

    Args:
        depth: the depth that the map is built from: of the "sensor" or "predicted" by the depth model.
        resolution: edge of a map cell in metres.
        max_range: distance along the floor in metres up to which depth enters the map.
        safety_margin: distance in metres that paths keep from obstacles, besides the robot's radius.
        unknown_traversable: whether paths may lead through unknown cells.
        depth_option: the subclass's name of the option `depth`, for error messages.
        motion: "arcs" for steps between turns if there is room, or "turns" for turns on the spot.
        least_way: least path length in metres to a frontier, if any is that far (`preferred_frontiers`).
        depth_error: relative depth error that the map allows for. None is 0 for the sensor's depth; for predicted depth
            it is the error at the sparse points, averaged over frames (`Observation.depth_error`).
        max_incidence: degrees between the line of sight and a surface's normal above which pixels of predicted depth
            are not mapped.
        visited_is_free: whether floor that the robot has been on stays free, and its way back open, whatever later
            frames of predicted depth show.

    Raises:
        DeuxError: `depth` or `motion` is neither of the two, or a number is out of its range.
    """

    frontier_reach = 0.3
    """Metres from a frontier cell within which the robot may stop to look at it."""

    min_frontier = 0.3
    """Least length of a frontier in metres; shorter ones are gaps between pixels."""

    preferred_frontier = 0.6
    """Length in metres from which on a frontier is preferred to shorter ones."""

    least_area = 3.0
    """Reachable floor in square metres without a frontier below which the map is assumed to be wrong.

    It is about the size of the blind zone around a robot whose depth errors turn all visible floor into obstacles.
    """

    most_targets_a_step = 10
    """Number of targets that are tried in one step, since some may be reached already or unreachable."""

    remembered_errors = 20
    """Number of frames over which the measured depth error is averaged."""

    most_depth_error = 0.2
    """Largest relative error that a map allows for: with more, obstacles below a quarter of a metre would be floor."""

    escape_distance = 1.0
    """Metres that the robot moves straight on after a random turn if the map confines it."""

    def __init__(
        self,
        depth: DepthSource,
        resolution: float,
        max_range: float,
        safety_margin: float,
        unknown_traversable: bool,
        depth_option: str = "depth",
        motion: Motion = "turns",
        least_way: float = 0.0,
        depth_error: float | None = None,
        max_incidence: float = 90.0,
        visited_is_free: bool = False,
    ) -> None:
        if depth not in ("predicted", "sensor"):
            raise DeuxError(f'{depth_option} is "{depth}": it must be "predicted" or "sensor".')
        if motion not in ("arcs", "turns"):
            raise DeuxError(f'explore.motion is "{motion}": it must be "arcs" or "turns".')
        check_range("explore.resolution", resolution, 0.0, 0.5, ends=False)
        check_range("explore.max_range", max_range, 0.0, 1000.0, ends=False)
        check_range("explore.safety_margin", safety_margin, 0.0, 10.0)
        check_range("explore.least_way", least_way, 0.0)
        check_range("explore.depth_error", depth_error or 0.0, 0.0, 1.0)
        check_range("explore.max_incidence", max_incidence, 0.0, 90.0)
        self.needs = frozenset({Need.PREDICTED_DEPTH if depth == "predicted" else Need.SENSOR_DEPTH})
        self._depth = depth
        predicted = replace(PREDICTED, incidence=max_incidence, visited_is_free=visited_is_free)
        errors = predicted if depth == "predicted" else EXACT
        self._errors = errors if depth_error is None else replace(errors, relative=depth_error)
        self._measures_error = depth == "predicted" and depth_error is None
        self._resolution = resolution
        self._max_range = max_range
        self._safety_margin = safety_margin
        self._unknown_traversable = unknown_traversable
        self.motion = motion
        self._least_way = least_way

    @abstractmethod
    def choose_target(self, pose: np.ndarray, candidates: FrontierCandidates, distance: np.ndarray) -> Target | None:
        """Choose the next target; None if there is none.

        Args:
            pose: 4 x 4, the camera's current camera-to-world matrix.
            candidates: the reachable frontier cells; may be empty.
            distance: rows x columns float64 over `self.occupancy.frame`: path length from the robot in cells, inf if
                unreachable.
        """

    def target_is_stale(self, target: Target) -> bool:
        """Whether to abandon the target; called before each action."""
        return False

    def actions_to(self, pose: np.ndarray, candidates: FrontierCandidates) -> np.ndarray:
        """Least actions to stand at each candidate's place and face its cell, N float64; see `action_costs`."""
        frame = self.occupancy.frame
        traversable = self._traversable(frame.cell(pose[0, 3], pose[2, 3]), self._clearance)
        cells, places = candidates.cells, candidates.places
        right, down = (cell_centres(frame, cells) - cell_centres(frame, places)).T
        costs = action_costs(traversable, frame, pose, self.robot)
        facing = costs.to_views(places, np.arctan2(-right, -down))
        return np.where((cells == places).all(axis=1), costs.to(places), facing)

    def reset(self, episode: Episode) -> None:
        """Begin an episode, with no state left from an earlier one."""
        self.rng = np.random.default_rng(episode.seed)
        self.robot = episode.robot
        self.occupancy = OccupancyMap(episode.camera, episode.robot, self._resolution, self._max_range, self._errors)
        self._recovery = Recovery(episode.robot, self.rng)
        self._pursuit: Pursuit | None = None
        self.frontier: Point | None = None
        field_of_view = math.radians(episode.camera.hfov)
        self.finished = FinishedFrontiers(self.frontier_reach, field_of_view)
        self._clearance = self._clearances()[0]
        self._depth_errors: deque[float] = deque(maxlen=self.remembered_errors)

    def act(self, observation: Observation) -> Action:
        """Update the map, then move towards the target."""
        self.occupancy.update(self.map_depth(observation), observation.pose, self.depth_error(observation))
        self.mapped(observation)
        action = self._recovery.action(observation.pose, observation.collided)
        if self._recovery.failures > 0:
            self.occupancy.mark_contact(observation.pose)
        return self._pursue(observation.pose) if action is None else action

    def mapped(self, observation: Observation) -> None:
        """Hook for subclasses: called after each update of the map, before a target is chosen."""

    def map_depth(self, observation: Observation) -> np.ndarray:
        """The depth image that the map is built from, H x W float32 metres."""
        depth = observation.predicted_depth if self._depth == "predicted" else observation.sensor_depth
        assert depth is not None
        return depth

    def depth_error(self, observation: Observation) -> float | None:
        """The relative error of the current frame's depth; None to use the constructor's.

        It is the mean over the last `remembered_errors` frames, since a single frame has only some forty points, and
        the error hardly changes between frames.
        """
        if self._measures_error and observation.depth_error is not None and math.isfinite(observation.depth_error):
            self._depth_errors.append(observation.depth_error)
        if not self._depth_errors:
            return None
        return min(float(np.mean(self._depth_errors)), self.most_depth_error)

    def fingerprint(self) -> str | None:
        """Distinguishes explorers whose map allows for measured errors, which is not visible in the options."""
        return "measured depth errors" if self._measures_error else None

    def map(self) -> ExplorerMap | None:
        """The current occupancy map and target; None before the first step."""
        if self.occupancy.cells.size == 0:
            return None
        target = None if self._pursuit is None else self._pursuit.target.place
        return ExplorerMap(self.occupancy.frame, self.occupancy.cells.copy(), target=target)

    def frontiers(self, distance: np.ndarray) -> FrontierCandidates:
        """The reachable frontier cells that are not finished."""
        cells, frame = self.occupancy.cells, self.occupancy.frame
        finished = self.finished.mask(frame)
        least = self._in_cells(self.min_frontier)
        return frontier_candidates(cells, frame, distance, least, self.frontier_reach, finished)

    def preferred_frontiers(self, candidates: FrontierCandidates) -> FrontierCandidates:
        """The candidates preferred by `least_way` and `preferred_frontier`; all if `least_way` is 0."""
        if self._least_way == 0.0:
            return candidates
        return candidates.preferred(self._least_way / self._resolution, self._in_cells(self.preferred_frontier))

    def _in_cells(self, metres: float) -> int:
        return max(1, round(metres / self._resolution))

    def frontier_target(self, candidates: FrontierCandidates, index: int) -> Target:
        """The target for one of the candidates; remembers its frontier cell as `self.frontier`."""
        cell, place = candidates.cells[index], candidates.places[index]
        self.frontier = self.occupancy.frame.centre(float(cell[0]), float(cell[1]))
        return frontier_target(self.occupancy.cells, self.occupancy.frame, cell, place, self.frontier_reach)

    def frontier_is_resolved(self) -> bool:
        """Whether no frontier cell is left around the target's; false if the target is not on a frontier."""
        if self.frontier is None:
            return False
        return not self.finished.any_left(self.occupancy.cells, self.occupancy.frame, self.frontier)

    def free_places(self, distance: np.ndarray, count: int) -> np.ndarray:
        """Up to `count` random reachable cells, N x 2 (row, column); there is at least one."""
        reachable = np.argwhere(np.isfinite(distance))
        return self.rng.choice(reachable, min(count, len(reachable)), replace=False)

    def _pursue(self, pose: np.ndarray) -> Action:
        """The next action towards the current target or, if its pursuit has ended, a new one; random without any."""
        here = self.occupancy.frame.cell(pose[0, 3], pose[2, 3])
        for _ in range(self.most_targets_a_step):
            if self._pursuit is not None and self.target_is_stale(self._pursuit.target):
                self._end(self._pursuit, pose)
            if self._pursuit is None:
                target = self._next_target(pose, here)
                if target is None:
                    return self._recovery.turn_away(math.ceil(self.escape_distance / self.robot.forward_step))
                self._pursuit = Pursuit(target, self.robot, motion=self.motion)
            action = self._pursuit.act(pose, self._traversable(here, self._clearance), self.occupancy.frame)
            if action is not None:
                return action
            self._end(self._pursuit, pose)
        return self._recovery.turn_away()

    def _end(self, pursuit: Pursuit, pose: np.ndarray) -> None:
        """End the pursuit of a target; what remains of its frontier is not chosen again."""
        if self.frontier is not None:
            seen_from = pose if pursuit.reached else None
            self.finished.finish(self.occupancy.cells, self.occupancy.frame, self.frontier, seen_from)
        self.frontier = self._pursuit = None

    def _next_target(self, pose: np.ndarray, here: tuple[int, int]) -> Target | None:
        """The subclass's choice; None if the map confines the robot (`least_area`), which then moves randomly.

        Such a map is wrong. Random moves, "unstuck" in Algorithm 1, correct it: floor that the robot drives over is
        free whatever its depth, and obstacles remain only where the robot collides.
        """
        reach = self._reach(here)
        if reach is None:
            return None
        self._clearance = reach.clearance
        return self.choose_target(pose, reach.candidates, reach.distance)

    def _reach(self, here: tuple[int, int]) -> Reach | None:
        """What the robot can reach with the greatest clearance with which it can reach a frontier.

        With the safety margin alone, the robot would not pass through every passage that it fits through. Without any
        frontier, the greatest clearance is used that does not confine the robot to `least_area`; None if each does.
        """
        best = None
        for clearance in self._clearances():
            distance = distance_field(self._traversable(here, clearance), here)
            reach = Reach(clearance, distance, self.frontiers(distance))
            if len(reach.candidates) > 0:
                return reach
            area = np.count_nonzero(np.isfinite(distance)) * self._resolution**2
            if best is None and area >= self.least_area:
                best = reach
        return best

    def _clearances(self) -> tuple[float, float]:
        """Radii in cells by which obstacles are dilated: with the safety margin, and for passages as wide as the robot.

        The second is one cell less than the robot's radius: obstacles fill every cell that they touch, which makes
        passages on the map up to two cells narrower.
        """
        radius = self.robot.radius / self._resolution
        return radius + self._safety_margin / self._resolution, max(0.0, radius - 1.0)

    def _traversable(self, here: tuple[int, int], clearance: float) -> np.ndarray:
        traversable = process_map(self.occupancy.cells, clearance, [here], self._unknown_traversable)
        if self._errors.visited_is_free:
            traversable |= self.occupancy.trace & (self.occupancy.cells != OCCUPIED)
        return traversable
