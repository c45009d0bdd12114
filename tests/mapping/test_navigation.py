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


def drive(motion, wanted, steps=60, open_cells=OPEN):
    """Follow a straight path from the origin to a point; returns the actions and how near the robot came."""
    follower, robot = PathFollower(Robot(), motion=motion), Robot()
    x, z, yaw, actions, nearest = 0.0, 0.0, 0.0, [], math.inf
    for _ in range(steps):
        pose = camera_pose(x, 1.25, z, yaw)
        nearest = min(nearest, math.hypot(wanted[0] - x, wanted[1] - z))
        if nearest <= 0.2:
            break
        path = np.linspace((x, z), wanted, 40)
        actions.append(follower.action(pose, path, open_cells, FRAME))
        if actions[-1] is Action.FORWARD:
            x, z = x + robot.forward_step * pose[0, 2], z + robot.forward_step * pose[2, 2]
        else:
            yaw += math.radians(robot.turn_angle) * (1 if actions[-1] is Action.LEFT else -1)
    return actions, nearest


@pytest.mark.parametrize("degrees", [20, 50, 100, -160])
@pytest.mark.parametrize("distance", [0.5, 1.0, 2.2])
def test_arcs_arrive_with_about_as_many_actions_as_turns_on_the_spot(distance, degrees):
    wanted = -distance * math.sin(math.radians(degrees)), -distance * math.cos(math.radians(degrees))
    arcs, nearest = drive("arcs", wanted)
    assert nearest <= 0.2
    longer = math.ceil(math.degrees(PathFollower.widest_arc) / 10.0) + 1  # an arc doubles the angle; and one step
    assert len(arcs) <= len(drive("turns", wanted)[0]) + longer


def test_arcs_step_between_turns_only_where_there_is_room():
    wanted = (-1.3, -1.6)
    arcs = drive("arcs", wanted)[0]
    first_step, last_turn = arcs.index(Action.FORWARD), len(arcs) - 1 - arcs[::-1].index(Action.LEFT)
    assert first_step < last_turn
    walled = OPEN.copy()
    walled[:48, 48:] = False  # what lies ahead of the robot, which stands in cell (50, 50)
    spot = drive("arcs", wanted, open_cells=walled)[0]
    assert spot.index(Action.FORWARD) > first_step
