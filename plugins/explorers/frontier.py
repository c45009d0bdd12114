"""The frontier explorer (Yamauchi 1997), with paths by A*."""

from typing import Literal

import numpy as np

from deux.errors import DeuxError
from deux.mapping.frontier_targets import FrontierCandidates, cell_centres
from deux.mapping.goal_explorer import DepthSource, GoalExplorer
from deux.mapping.navigation import Motion, heading_error
from deux.mapping.pursuit import Target


class FrontierExplorer(GoalExplorer):
    """Drives to frontiers between free and unknown cells until none is left, then to random places.

    A frontier that is resolved on the way, by coming into view, is abandoned. One that remains after the robot has
    looked at it from nearby is not chosen again.

    Args:
        depth: the depth that the map is built from: of the "sensor" or "predicted" by the depth model.
        choose: "nearest", the frontier that takes the fewest actions, turns included (Yamauchi); or "largest", a
            random place on one of the three largest (the published agent of exploring_exploration).
        resolution: edge of a map cell in metres.
        max_range: distance along the floor in metres up to which depth is mapped. None is 5 for the sensor's depth and
            3 for predicted depth, whose errors grow with the distance.
        depth_error: relative depth error that the map allows for: if it is too small, errors turn floor into obstacles;
            if it is too large, low obstacles become floor. None is 0 for the sensor's depth; for predicted depth it is
            the error measured at the frames' sparse points (`Observation.depth_error`).
        max_incidence: degrees between the line of sight and a surface's normal above which pixels of predicted depth
            are not mapped. 81 excludes the ramps by which networks blur steps in depth but, in images of 64 x 64
            pixels, also some small obstacles. 90 excludes nothing. No effect on the sensor's depth.
        safety_margin: distance in metres that paths keep from obstacles, besides the robot's radius.
        unknown_traversable: whether paths may lead through unknown cells.
        motion: "arcs" for turning while moving, if there is room; or "turns" for turning on the spot.
        least_way: least path length in metres to a frontier, if there is a large enough one that far away. Nearer ones
            are mostly edges of the view beside the robot, for which it would turn on the spot. 0 for no limit.
    """

    def __init__(
        self,
        depth: DepthSource = "sensor",
        choose: Literal["nearest", "largest"] = "nearest",
        resolution: float = 0.05,
        max_range: float | None = None,
        depth_error: float | None = None,
        max_incidence: float = 90.0,
        safety_margin: float = 0.05,
        unknown_traversable: bool = False,
        motion: Motion = "arcs",
        least_way: float = 1.5,
    ) -> None:
        if max_range is None:
            max_range = 3.0 if depth == "predicted" else 5.0
        super().__init__(
            depth,
            resolution,
            max_range,
            safety_margin,
            unknown_traversable,
            depth_option="frontier's depth",
            motion=motion,
            least_way=least_way,
            depth_error=depth_error,
            max_incidence=max_incidence,
        )
        if choose not in ("nearest", "largest"):
            raise DeuxError(f'frontier\'s choose is "{choose}": it must be "nearest" or "largest".')
        self._choose = choose

    def choose_target(self, pose: np.ndarray, candidates: FrontierCandidates, distance: np.ndarray) -> Target | None:
        """Choose a frontier, or a random reachable place if none is left."""
        if len(candidates) == 0:
            row, column = self.free_places(distance, 1)[0]
            return Target(self.occupancy.frame.centre(row, column))
        candidates = self.preferred_frontiers(candidates)
        if self._choose == "nearest":
            arcs = self.motion == "arcs"
            actions = self.actions_to(pose, candidates) if arcs else self._estimated_actions(pose, candidates)
            index = int(np.argmin(actions))
        else:
            largest = np.unique(candidates.frontier)[:3]
            index = int(self.rng.choice(np.flatnonzero(candidates.frontier == self.rng.choice(largest))))
        return self.frontier_target(candidates, index)

    def _estimated_actions(self, pose: np.ndarray, candidates: FrontierCandidates) -> np.ndarray:
        """Estimated number of actions for each candidate: turns to face it, and steps along the path."""
        x, z = cell_centres(self.occupancy.frame, candidates.cells).T
        turns = np.degrees(np.abs(heading_error(pose, x, z))) / self.robot.turn_angle
        return turns + candidates.lengths * self.occupancy.resolution / self.robot.forward_step

    def target_is_stale(self, target: Target) -> bool:
        """Whether no frontier cell is left around the chosen one."""
        return self.frontier_is_resolved()
