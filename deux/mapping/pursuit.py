"""Going to one target: plan, follow, replan, arrive or give up (the inner loop of Algorithm 1)."""

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
    """A place to go to, in world coordinates (x, z).

    Args:
        place: where to stand.
        look_at: what to face there; None if the heading does not matter.
    """

    place: Point
    look_at: Point | None = None


class Pursuit:
    """Drives one robot to one target, with a path that is planned anew where needed; make one for each target.

    The path is planned anew when the map blocks it or the robot has left it. The pursuit ends when the robot
    stands at the target and faces it, when no path leads there, when `patience` actions brought the robot no
    closer along its path, or after `most_steps` actions. Since every pursuit ends, a robot cannot be held by a
    target that it will never reach.

    Args:
        target: where to go.
        robot: its motion.
        patience: actions without progress after which the target is given up; a half turn takes 18.
        most_steps: actions after which the target is given up in any case (exploring_exploration's 200).
        motion: how it turns on its path, see `PathFollower`.
    """

    goal_radius = 0.2
    """Metres from the place within which the robot has arrived; with steps of 0.25 m it may not get closer."""

    look_tolerance = math.radians(20.0)
    """Heading error within which the robot faces what it was to look at."""

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
        """The next action, or None if the pursuit is over: then `reached` tells how it ended.

        Args:
            pose: 4 x 4 camera-to-world.
            traversable: rows x columns bool, see `process_map`.
            frame: where `traversable` lies; it may have grown since the last call.
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
        """Turn towards what is to be looked at; None once the robot faces it."""
        if self.target.look_at is not None:
            error = heading_error(pose, *self.target.look_at)
            if abs(error) > max(self.look_tolerance, math.radians(self._robot.turn_angle)):
                return turn_towards(error)
        self.reached = True
        return None

    def _remaining_path(self, pose: np.ndarray, traversable: np.ndarray, frame: GridFrame) -> np.ndarray | None:
        """What is left of the path as world (x, z), planned anew if need be; None if no path leads to the place."""
        if self._path is not None:
            distances = np.hypot(self._path[:, 0] - pose[0, 3], self._path[:, 1] - pose[2, 3])
            nearest = int(np.argmin(distances))
            rest = self._path[nearest:]
            rows, columns = frame.cells(rest[:, 0], rest[:, 1])
            if distances[nearest] <= self._robot.forward_step and traversable[rows, columns].all():
                self._path = rest
                return rest
            # A detour may be longer than what was left before: progress is counted afresh.
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
