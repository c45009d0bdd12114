"""Path following: from a path on the map to the robot's actions."""

import math
from typing import Literal, TypeVar

import numpy as np

from deux.contracts import Action, Robot
from deux.geometry.grid import GridFrame
from deux.geometry.poses import yaw_of
from deux.mapping.planning import line_is_clear

Motion = Literal["arcs", "turns"]
"""How a robot turns on a path: on arcs, while moving, or on the spot."""

Coordinate = TypeVar("Coordinate", float, np.ndarray)


def heading_error(pose: np.ndarray, x: Coordinate, z: Coordinate) -> Coordinate:
    """Angle in radians, in [-pi, pi), by which the robot must turn left to face world point (x, z), or several."""
    wanted = np.arctan2(pose[0, 3] - x, pose[2, 3] - z)
    return (wanted - yaw_of(pose) + math.pi) % (2.0 * math.pi) - math.pi


def turn_towards(error: float) -> Action:
    """The turn that reduces a heading error."""
    return Action.LEFT if error > 0.0 else Action.RIGHT


class PathFollower:
    """Follows a path: turns towards the next waypoint until the heading error is at most half a turn, then moves on.

    The waypoint, `Path[delta_next]` of Algorithm 1, is the farthest point of the path within the lookahead that can be
    reached in a straight line. A turn that would only undo the previous turn is replaced by a step forward, so that the
    robot cannot oscillate on the spot.

    With the motion "arcs", it also steps forward between turns if the next step is free. A step after every k turns by
    an angle a moves it on a circle of radius r = step / (k a). A waypoint at distance d and heading error e lies on or
    outside that circle, so that the robot does not circle around it, if d >= 2 r sin|e|. The robot then turns by up to
    e more than on the spot, in exchange for frames with parallax.

    Args:
        robot: provides turn angle and forward step.
        lookahead: largest distance to the waypoint in metres; None for 1 with turns on the spot and 2 with arcs.
        motion: how the robot turns.
    """

    widest_arc = math.radians(60.0)
    """Heading error above which the robot turns on the spot, since a step would hardly bring it closer."""

    def __init__(self, robot: Robot, lookahead: float | None = None, motion: Motion = "turns") -> None:
        self._robot = robot
        self._arcs = motion == "arcs"
        if lookahead is None:
            lookahead = 2.0 if self._arcs else 1.0
        self._turns = 0  # since the last step forward
        self._tolerance = math.radians(robot.turn_angle) / 2.0 + 1e-6
        self._lookahead = lookahead
        self._last: Action | None = None

    def action(self, pose: np.ndarray, path: np.ndarray, traversable: np.ndarray, frame: GridFrame) -> Action:
        """The next action.

        Args:
            pose: 4 x 4 camera-to-world.
            path: N x 2 world (x, z), from the robot to the goal.
            traversable: rows x columns bool, the cells that straight lines may cross.
            frame: frame of `traversable`.
        """
        x, z = self._waypoint(pose, path, traversable, frame)
        error = heading_error(pose, x, z)
        action = Action.FORWARD
        if abs(error) > self._tolerance:
            action = turn_towards(error)
            undone = {action, self._last} == {Action.LEFT, Action.RIGHT}
            if undone or (self._arcs and self._may_arc(pose, x, z, error, traversable, frame)):
                action = Action.FORWARD
        self._turns = 0 if action is Action.FORWARD else self._turns + 1
        self._last = action
        return action

    def _may_arc(
        self, pose: np.ndarray, x: float, z: float, error: float, traversable: np.ndarray, frame: GridFrame
    ) -> bool:
        """Whether stepping before the next turn leads to waypoint (x, z) on an arc, and the step is free."""
        if self._turns == 0 or abs(error) > self.widest_arc:
            return False
        radius = self._robot.forward_step / (self._turns * math.radians(self._robot.turn_angle))
        if math.hypot(x - pose[0, 3], z - pose[2, 3]) < 2.0 * radius * math.sin(abs(error)):
            return False
        forward = pose[[0, 2], 2] / np.linalg.norm(pose[[0, 2], 2])
        end = pose[[0, 2], 3] + forward * (self._robot.forward_step + frame.resolution)
        return bool(line_is_clear(traversable, frame.cell(pose[0, 3], pose[2, 3]), frame.cell(*end)))

    def _waypoint(self, pose: np.ndarray, path: np.ndarray, traversable: np.ndarray, frame: GridFrame) -> np.ndarray:
        """World (x, z) of the point to head for."""
        here = frame.cell(pose[0, 3], pose[2, 3])
        distances = np.hypot(path[:, 0] - pose[0, 3], path[:, 1] - pose[2, 3])
        beyond = np.flatnonzero(distances > self._lookahead)
        within = int(beyond[0]) if len(beyond) else len(path) - 1
        for index in range(within, 0, -1):
            if line_is_clear(traversable, here, frame.cell(*path[index])):
                return path[index]
        return path[min(1, len(path) - 1)]
