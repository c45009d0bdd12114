"""The frontier explorer (Yamauchi 1997), with A* for its paths."""

from typing import Literal

import numpy as np

from deux.errors import DeuxError
from deux.mapping.frontier_targets import FrontierCandidates, cell_centres
from deux.mapping.goal_explorer import DepthSource, GoalExplorer
from deux.mapping.navigation import Motion, heading_error
from deux.mapping.pursuit import Target


class FrontierExplorer(GoalExplorer):
    """Goes to frontiers between free floor and the unknown until none is left, then to random places.

    A frontier that resolves itself on the way (it came into view) is dropped at once. One that is still there after
    the robot stood before it and looked at it is not chosen again.

    Args:
        depth: what the map is built from, the depth "sensor" or the depth model's "predicted" depth.
        choose: "nearest", the frontier that takes the fewest actions, turns included (Yamauchi); or "largest", a
            random place on one of the three largest (the published agent of exploring_exploration).
        resolution: edge of a map cell in metres.
        max_range: distance along the floor in metres up to which depth enters the map. None is 5 for the sensor's depth
            and 3 for predicted depth, whose errors grow with the distance.
        depth_error: relative error of the depth that the map allows for: with too little, errors of the floor become
            obstacles, with too much, low obstacles become floor. None is 0 for the sensor's depth; for predicted depth
            it is what the frames' sparse points show (`Observation.depth_error`).
        max_incidence: degrees between the line of sight and a surface's normal above which pixels do not enter the map.
            81 leaves out the ramps that a network makes of steps in depth; in images of 64 x 64 pixels small obstacles
            go with them. 90 leaves nothing out.
        safety_margin: metres that paths keep from obstacles beyond the robot's radius.
        unknown_traversable: whether paths may lead through the unknown.
        motion: "arcs", turns while it goes on, where there is room; or "turns", on the spot.
        least_way: metres of path to its frontier at least, where a frontier of some size is that far. Nearer ones are
            mostly edges of the view beside the robot, for which it would turn on the spot. 0 for any.
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
            "frontier's depth",
            motion,
            least_way,
            depth_error,
            max_incidence,
        )
        if choose not in ("nearest", "largest"):
            raise DeuxError(f'frontier\'s choose is "{choose}": it must be "nearest" or "largest".')
        self._choose = choose

    def choose_target(self, pose: np.ndarray, candidates: FrontierCandidates, distance: np.ndarray) -> Target | None:
        """A frontier; a random reachable place if none is left."""
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
        """About how many actions each candidate costs: the turn to face it and the steps along the path."""
        x, z = cell_centres(self.occupancy.frame, candidates.cells).T
        turns = np.degrees(np.abs(heading_error(pose, x, z))) / self.robot.turn_angle
        return turns + candidates.lengths * self.occupancy.resolution / self.robot.forward_step

    def target_is_stale(self, target: Target) -> bool:
        """Whether no frontier cell is left around the one that was chosen."""
        return self.frontier_is_resolved()
