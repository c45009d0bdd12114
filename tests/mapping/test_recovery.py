import math

import numpy as np
import pytest

from deux.contracts import Action, Robot
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.mapping.recovery import Recovery
from deux.testing.box_world import Box, BoxWorld

SMALL = Camera(8, 8)


def recovery(robot=None, seed=0, **options):
    return Recovery(robot or Robot(), np.random.default_rng(seed), **options)


def searching(robot=None, patience=5):
    """A recovery that searches as soon as the robot is confined, and never turns at random."""
    return recovery(robot, most_failures=10_000, most_confined=1, patience=patience)


def pen(gap_from, gap_to, side):
    """A pen of 0.6 x 0.6 m inside, in the middle of a room of 4 x 4 m, with one gap in its side 0 (+x), 1, 2 or 3."""
    spans = [[(1.6, 2.4)], [(1.6, 2.4)], [(1.6, 2.4)], [(1.6, 2.4)]]
    spans[side] = [(1.6, gap_from), (gap_to, 2.4)]
    boxes = [Box(2.3, a, 2.4, b, 0.5) for a, b in spans[0]] + [Box(1.6, a, 1.7, b, 0.5) for a, b in spans[1]]
    boxes += [Box(a, 2.3, b, 2.4, 0.5) for a, b in spans[2]] + [Box(a, 1.6, b, 1.7, 0.5) for a, b in spans[3]]
    return BoxWorld(4.0, 4.0, tuple(boxes), camera=SMALL)


def steps_to_leave(world, most=200):
    """Actions until the robot is 0.5 m from where it was, forward where there is no search; None if it never is."""
    found = searching(world.robot)
    start, collided = world.pose[[0, 2], 3], world.step(Action.FORWARD)
    for step in range(most):
        if np.hypot(*(world.pose[[0, 2], 3] - start)) > 0.5:
            return step
        collided = world.step(found.action(world.pose, collided) or Action.FORWARD)
    return None


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("gap", [(1.75, 2.05), (1.85, 2.15), (1.95, 2.25)])
def test_the_search_finds_a_gap_of_30_cm_in_a_pen(side, gap):
    for yaw in np.arange(0.0, 2.0 * math.pi, 0.5):
        world = pen(*gap, side)
        world.reset(2.0, 2.0, yaw)
        assert steps_to_leave(world) is not None


def test_the_search_finds_the_gap_for_robots_that_turn_by_other_angles():
    for turn_angle in (7.0, 30.0, 45.0):
        world = pen(1.85, 2.15, 0)
        world.robot = Robot(turn_angle=turn_angle)
        world.reset(2.0, 2.0, 2.0)
        assert steps_to_leave(world) is not None


def test_the_search_pauses_after_it_has_turned_both_ways_in_vain():
    pose = camera_pose(2.0, 1.25, 2.0, 0.0)
    found = searching()
    actions = [found.action(pose, True) for _ in range(148)]
    expected = [Action.FORWARD, Action.LEFT, Action.LEFT] * 23 + [Action.FORWARD, Action.RIGHT, Action.RIGHT] * 23
    assert actions == [None] * 5 + expected + [None] * 5


def test_a_robot_that_touches_nothing_is_left_alone():
    found = recovery(patience=5)
    assert all(found.action(camera_pose(2.0, 1.25, 2.0, 0.1 * i), False) is None for i in range(30))


def test_a_robot_that_slides_along_walls_is_left_alone():
    found = recovery(patience=5)
    assert all(found.action(camera_pose(0.2 * i, 1.25, 2.0, 0.0), True) is None for i in range(30))


def test_every_contact_counts_if_it_is_to():
    found = recovery(most_failures=1, least_move=math.inf)
    assert found.action(camera_pose(0.0, 1.25, 0.0, 0.0), False) is None
    assert found.action(camera_pose(0.2, 1.25, 0.0, 0.0), True) in (Action.LEFT, Action.RIGHT)


def test_a_blocked_robot_turns_one_way_by_30_to_180_degrees_and_then_steps():
    pose, sides = camera_pose(2.0, 1.25, 2.0, 0.0), set()
    for seed in range(200):
        found = recovery(Robot(turn_angle=10.0), seed)
        assert [found.action(pose, collided) for collided in (False, True)] == [None, None], "one failure is no sign"
        moves = [found.action(pose, True)]
        while (action := found.action(pose, False)) is not None:
            moves.append(action)
        assert moves[-1] is Action.FORWARD
        assert len(set(moves[:-1])) == 1
        assert 3 <= len(moves) - 1 <= 18
        sides.add(moves[0])
    assert sides == {Action.LEFT, Action.RIGHT}


def test_a_robot_that_turns_away_goes_as_far_as_configured():
    found = recovery()
    pose = camera_pose(2.0, 1.25, 2.0, 0.0)
    moves = [found.turn_away(steps=4)]
    while (action := found.action(pose, False)) is not None:
        moves.append(action)
    assert moves[-5:].count(Action.FORWARD) == 4
    assert moves.count(Action.FORWARD) == 4


def test_forward_actions_that_move_nothing_are_counted_and_slides_are_not():
    found = recovery(Robot(forward_step=0.25), most_failures=10)
    # World x after an action, whether it was cut short, and how many have then failed in a row.
    steps = [
        (0.00, False, 0),
        (0.25, False, 0),
        (0.26, True, 1),
        (0.26, False, 0),  # a turn
        (0.27, True, 2),
        (0.40, True, 0),  # a slide
        (0.40, True, 1),
    ]
    for x, collided, expected in steps:
        found.action(camera_pose(x, 1.25, 0.0, 0.7), collided)
        assert found.failures == expected
