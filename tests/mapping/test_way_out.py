import math

import numpy as np
import pytest

from deux.contracts import Action
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.mapping.way_out import WayOut
from deux.testing.box_world import Box, BoxWorld

SMALL = Camera(8, 8)


def pen(gap_from, gap_to, side):
    """A pen of 0.6 x 0.6 m inside, in the middle of a room of 4 x 4 m, with one gap in its side 0 (+x), 1, 2 or 3."""
    spans = [[(1.6, 2.4)], [(1.6, 2.4)], [(1.6, 2.4)], [(1.6, 2.4)]]
    spans[side] = [(1.6, gap_from), (gap_to, 2.4)]
    boxes = [Box(2.3, a, 2.4, b, 0.5) for a, b in spans[0]] + [Box(1.6, a, 1.7, b, 0.5) for a, b in spans[1]]
    boxes += [Box(a, 2.3, b, 2.4, 0.5) for a, b in spans[2]] + [Box(a, 1.6, b, 1.7, 0.5) for a, b in spans[3]]
    return BoxWorld(4.0, 4.0, tuple(boxes), camera=SMALL)


def steps_to_leave(world, patience=5, most=200):
    """Actions until the robot is 0.5 m from where it was, forward where there is no search; None if it never is."""
    way_out = WayOut(world.robot, patience=patience)
    start, collided = world.pose[[0, 2], 3], world.step(Action.FORWARD)
    for step in range(most):
        if np.hypot(*(world.pose[[0, 2], 3] - start)) > 0.5:
            return step
        collided = world.step(way_out.action(world.pose, collided) or Action.FORWARD)
    return None


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("gap", [(1.75, 2.05), (1.85, 2.15), (1.95, 2.25)])
def test_finds_a_gap_of_30_cm_in_a_pen(side, gap):
    for yaw in np.arange(0.0, 2.0 * math.pi, 0.5):
        world = pen(*gap, side)
        world.reset(2.0, 2.0, yaw)
        assert steps_to_leave(world) is not None


def test_finds_the_gap_for_robots_that_turn_by_other_angles():
    for turn_angle in (7.0, 30.0, 45.0):
        world = pen(1.85, 2.15, 0)
        world.robot = type(world.robot)(turn_angle=turn_angle)
        world.reset(2.0, 2.0, 2.0)
        assert steps_to_leave(world) is not None


def test_leaves_a_robot_alone_that_touches_nothing():
    way_out = WayOut(BoxWorld(4.0, 4.0).robot, patience=5)
    assert all(way_out.action(camera_pose(2.0, 1.25, 2.0, 0.1 * i), False) is None for i in range(30))


def test_leaves_a_robot_alone_that_gets_about():
    way_out = WayOut(BoxWorld(4.0, 4.0).robot, patience=5)
    assert all(way_out.action(camera_pose(0.2 * i, 1.25, 2.0, 0.0), True) is None for i in range(30))


def test_pauses_after_it_has_turned_both_ways_in_vain():
    pose = camera_pose(2.0, 1.25, 2.0, 0.0)
    way_out = WayOut(BoxWorld(4.0, 4.0).robot, patience=5)
    actions = [way_out.action(pose, True) for _ in range(148)]
    searching = [action for action in actions[5:] if action is not None]
    assert actions == [None] * 5 + searching + [None] * 5
    assert (
        searching == [Action.FORWARD, Action.LEFT, Action.LEFT] * 23 + [Action.FORWARD, Action.RIGHT, Action.RIGHT] * 23
    )
