"""Path following: from a path on the map to the robot's actions."""

import math
from typing import TypeVar

import numpy as np

from deux.contracts import Action, Robot
from deux.geometry.grid import GridFrame
from deux.geometry.poses import yaw_of
from deux.mapping.planning import line_is_clear

Coordinate = TypeVar("Coordinate", float, np.ndarray)


def heading_error(pose: np.ndarray, x: Coordinate, z: Coordinate) -> Coordinate:
    """Angle in radians, in [-pi, pi), by which the robot must turn left to face world point (x, z), or each of many."""
    wanted = np.arctan2(pose[0, 3] - x, pose[2, 3] - z)
    return (wanted - yaw_of(pose) + math.pi) % (2.0 * math.pi) - math.pi


def turn_towards(error: float) -> Action:
    """The turn that makes a heading error smaller."""
    return Action.LEFT if error > 0.0 else Action.RIGHT


class PathFollower:
    """Follows a path: turns until the next waypoint lies within half a turn of straight ahead, then goes forward.

    The waypoint, `Path[delta_next]` of Algorithm 1, is the farthest point of the path within the lookahead that
    can be reached in a straight line. A turn that would only undo the turn before it is replaced by a step
    forward, so that the robot cannot swing left and right on the spot.

    Args:
        robot: its turn angle.
        lookahead: distance to the waypoint in metres.
    """

    def __init__(self, robot: Robot, lookahead: float = 1.0) -> None:
        self._tolerance = math.radians(robot.turn_angle) / 2.0 + 1e-6
        self._lookahead = lookahead
        self._last: Action | None = None

    def action(self, pose: np.ndarray, path: np.ndarray, traversable: np.ndarray, frame: GridFrame) -> Action:
        """The next action.

        Args:
            pose: 4 x 4 camera-to-world.
            path: N x 2 world (x, z), from the robot to the goal.
            traversable: rows x columns bool, where straight lines may go.
            frame: where `traversable` lies.
        """
        x, z = self._waypoint(pose, path, traversable, frame)
        error = heading_error(pose, x, z)
        action = Action.FORWARD
        if abs(error) > self._tolerance:
            action = turn_towards(error)
            if {action, self._last} == {Action.LEFT, Action.RIGHT}:
                action = Action.FORWARD
        self._last = action
        return action

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
