import math

import numpy as np
import pytest

from deux.contracts import Action, Robot
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.navigation import PathFollower, heading_error

OPEN = np.ones((100, 100), bool)
FRAME = GridFrame(-2.5, -2.5, 100, 100)


@pytest.mark.parametrize("degrees", [-170, -35, 0, 20, 90, 179])
@pytest.mark.parametrize("yaw", [-2.0, 0.0, 1.3])
def test_heading_error_is_the_turn_that_faces_the_point(degrees, yaw):
    pose = camera_pose(1.0, 1.25, 2.0, yaw)
    ahead = camera_pose(1.0, 1.25, 2.0, yaw + math.radians(degrees))[:3, 2]
    x, z = 1.0 + 3.0 * ahead[0], 2.0 + 3.0 * ahead[2]
    assert heading_error(pose, x, z) == pytest.approx(math.radians(degrees))


def straight_path(degrees):
    """From the origin one metre in a direction given in degrees to the left of -Z."""
    ahead = camera_pose(0.0, 0.0, 0.0, math.radians(degrees))[[0, 2], 2]
    return np.linspace(0.0, 1.0, 21)[:, None] * ahead


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        (0, Action.FORWARD),
        (4.9, Action.FORWARD),
        (-4.9, Action.FORWARD),
        (5.5, Action.LEFT),
        (-5.5, Action.RIGHT),
        (150, Action.LEFT),
    ],
)
def test_turns_only_if_off_by_more_than_half_a_turn(degrees, expected):
    follower = PathFollower(Robot(turn_angle=10.0))
    assert follower.action(camera_pose(0, 1.25, 0, 0.0), straight_path(degrees), OPEN, FRAME) is expected


def test_goes_forward_instead_of_undoing_the_last_turn():
    follower = PathFollower(Robot())
    pose = camera_pose(0, 1.25, 0, 0.0)
    assert follower.action(pose, straight_path(30), OPEN, FRAME) is Action.LEFT
    assert follower.action(pose, straight_path(-30), OPEN, FRAME) is Action.FORWARD
    assert follower.action(pose, straight_path(-30), OPEN, FRAME) is Action.RIGHT


def test_heads_for_the_corner_and_not_through_the_wall_behind_it():
    up = np.stack([np.zeros(9), -np.arange(9) * 0.05], axis=1)
    left = np.stack([-np.arange(1, 9) * 0.05, np.full(8, -0.4)], axis=1)
    path = np.concatenate([up, left])
    pose = camera_pose(0, 1.25, 0, 0.0)
    assert PathFollower(Robot(), 0.6).action(pose, path, OPEN, FRAME) is Action.LEFT
    walled = OPEN.copy()
    row, column = FRAME.cell(0.0, -0.35)
    walled[row:, :column] = False
    assert PathFollower(Robot(), 0.6).action(pose, path, walled, FRAME) is Action.FORWARD
