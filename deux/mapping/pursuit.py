"""Driving to one target: plan, follow and replan a path, arrive or give up (the inner loop of Algorithm 1)."""

import math
from dataclasses import dataclass

import numpy as np

from deux.contracts import Action, Robot
from deux.geometry.grid import GridFrame
from deux.mapping.navigation import Motion, PathFollower, heading_error, turn_towards
from deux.mapping.planning import path_length, shortest_path

Point = tuple[float, float]


@dataclass(frozen=True)
class Target:
    """A target in world coordinates (x, z).

    Args:
        place: the place to drive to.
        look_at: the point to face there; None for any heading.
    """

    place: Point
    look_at: Point | None = None


class Pursuit:
    """Drives a robot to one target; create a new one for each target.

    The path is replanned when the map blocks it or the robot has left it. The pursuit ends when the robot stands at the
    target and faces it, when no path leads there, after `patience` actions without progress along the path, or after
    `most_steps` actions, so that a robot cannot pursue an unreachable target forever.

    Args:
        target: the target.
        robot: provides the motion parameters.
        patience: actions without progress after which the target is abandoned; half a turn takes 18.
        most_steps: actions after which the target is abandoned in any case (exploring_exploration's 200).
        motion: how the robot turns on its path, see `PathFollower`.
    """

    goal_radius = 0.2
    """Distance in metres at which the robot has arrived; with steps of 0.25 m, it may not get closer."""

    look_tolerance = math.radians(20.0)
    """Heading error within which the robot faces the point to look at."""

    def __init__(
        self, target: Target, robot: Robot, patience: int = 40, most_steps: int = 200, motion: Motion = "turns"
    ) -> None:
        self.target = target
        self.reached = False
        self._robot = robot
        self._follower = PathFollower(robot, motion=motion)
        self._patience = patience
        self._steps_left = most_steps
        self._steps_since_progress = 0
        self._least_remaining = math.inf
        self._path: np.ndarray | None = None
        self._arrived = False

    def act(self, pose: np.ndarray, traversable: np.ndarray, frame: GridFrame) -> Action | None:
        """The next action, or None if the pursuit has ended; `reached` then says whether successfully.

        Args:
            pose: 4 x 4 camera-to-world.
            traversable: rows x columns bool, see `process_map`.
            frame: frame of `traversable`; the map may have grown since the last call.
        """
        self._steps_left -= 1
        self._steps_since_progress += 1
        goal_x, goal_z = self.target.place
        if math.hypot(goal_x - pose[0, 3], goal_z - pose[2, 3]) <= self._goal_radius:
            self._arrived = True
        if self._arrived:
            return self._look(pose)
        if self._steps_left < 0 or self._steps_since_progress > self._patience:
            return None
        path = self._remaining_path(pose, traversable, frame)
        if path is None:
            return None
        remaining = path_length(path)
        if remaining < self._least_remaining - 0.5 * self._robot.forward_step:
            self._least_remaining = remaining
            self._steps_since_progress = 0
        return self._follower.action(pose, path, traversable, frame)

    @property
    def _goal_radius(self) -> float:
        return max(self.goal_radius, 0.75 * self._robot.forward_step)

    def _look(self, pose: np.ndarray) -> Action | None:
        """Turn towards the point to look at; None once the robot faces it."""
        if self.target.look_at is not None:
            error = heading_error(pose, *self.target.look_at)
            if abs(error) > max(self.look_tolerance, math.radians(self._robot.turn_angle)):
                return turn_towards(error)
        self.reached = True
        return None

    def _remaining_path(self, pose: np.ndarray, traversable: np.ndarray, frame: GridFrame) -> np.ndarray | None:
        """The rest of the path as world (x, z), replanned if necessary; None if no path leads to the place."""
        if self._path is not None:
            distances = np.hypot(self._path[:, 0] - pose[0, 3], self._path[:, 1] - pose[2, 3])
            nearest = int(np.argmin(distances))
            rest = self._path[nearest:]
            rows, columns = frame.cells(rest[:, 0], rest[:, 1])
            if distances[nearest] <= self._robot.forward_step and traversable[rows, columns].all():
                self._path = rest
                return rest
            # A detour may be longer than the rest of the old path, so progress is measured from here.
            self._least_remaining = math.inf
        start = frame.cell(pose[0, 3], pose[2, 3])
        cells = shortest_path(traversable, start, frame.cell(*self.target.place))
        if cells is None:
            self._path = None
        else:
            x = frame.origin_x + (cells[:, 1] + 0.5) * frame.resolution
            z = frame.origin_z + (cells[:, 0] + 0.5) * frame.resolution
            self._path = np.stack([x, z], axis=1)
        return self._path
