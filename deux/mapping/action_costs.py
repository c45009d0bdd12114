"""How many actions it takes the robot to get to places and to views, turns included."""

import math
from dataclasses import dataclass

import numpy as np

from deux.contracts import Robot
from deux.geometry.grid import GridFrame
from deux.geometry.poses import yaw_of
from deux.mapping.planning import distance_field


@dataclass(frozen=True)
class ActionCosts:
    """Actions from the robot's pose: the turn to face the place, the steps along the path, the turn there."""

    distance: np.ndarray
    frame: GridFrame
    pose: np.ndarray
    robot: Robot

    def to(self, cells: np.ndarray) -> np.ndarray:
        """Actions to N x 2 cells (row, column), whatever the heading there; inf where no path leads."""
        return self._walk(cells) + self._turns(self._bearings(cells) - yaw_of(self.pose))

    def to_views(self, cells: np.ndarray, headings: np.ndarray) -> np.ndarray:
        """Actions to N x 2 cells with N headings in radians."""
        return self.to(cells) + self._turns(np.asarray(headings) - self._bearings(cells))

    def _walk(self, cells: np.ndarray) -> np.ndarray:
        return self.distance[cells[:, 0], cells[:, 1]] * self.frame.resolution / self.robot.forward_step

    def _bearings(self, cells: np.ndarray) -> np.ndarray:
        x = self.frame.origin_x + (cells[:, 1] + 0.5) * self.frame.resolution
        z = self.frame.origin_z + (cells[:, 0] + 0.5) * self.frame.resolution
        return np.arctan2(self.pose[0, 3] - x, self.pose[2, 3] - z)

    def _turns(self, angle: np.ndarray) -> np.ndarray:
        wrapped = (angle + math.pi) % (2.0 * math.pi) - math.pi
        return np.abs(wrapped) / math.radians(self.robot.turn_angle)


def action_costs(traversable: np.ndarray, frame: GridFrame, pose: np.ndarray, robot: Robot) -> ActionCosts:
    """The costs from a pose over a grid of traversable cells."""
    return ActionCosts(distance_field(traversable, frame.cell(pose[0, 3], pose[2, 3])), frame, pose, robot)
