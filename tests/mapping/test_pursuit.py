import math

import numpy as np
import pytest

from deux.mapping.navigation import heading_error
from deux.mapping.pursuit import Pursuit, Target
from deux.testing.box_world import Box, BoxWorld


@pytest.fixture
def world():
    """A room divided by a wall with a doorway at its far end; the robot on the left side."""
    made = BoxWorld(6.0, 5.0, (Box(2.9, 0.0, 3.1, 4.0),))
    made.reset(1.0, 1.0, 0.0)
    return made


def go(world, pursuit, traversable=None, steps=250):
    """Act until the pursuit ends; the number of actions."""
    space = world.free_space()
    traversable = space.clearance > world.robot.radius + 0.05 if traversable is None else traversable
    for step in range(steps):
        action = pursuit.act(world.pose, traversable, space.frame)
        if action is None:
            return step
        world.step(action)
    pytest.fail("the pursuit did not end")


def test_goes_round_the_wall_and_faces_what_it_is_to_look_at(world):
    pursuit = Pursuit(Target((5.0, 1.0), look_at=(3.5, 1.0)), world.robot)
    steps = go(world, pursuit)
    assert pursuit.reached
    assert math.dist(world.pose[[0, 2], 3], (5.0, 1.0)) <= 0.2
    assert abs(heading_error(world.pose, 3.5, 1.0)) <= math.radians(20.0)
    # Straight lines are 8 m, 32 steps; the turns at the start, the doorway and the end come to 40 actions.
    assert steps < 90


def test_gives_up_at_once_where_no_path_leads(world):
    traversable = world.free_space().clearance > 0.1
    traversable[:, 55:65] = False
    pursuit = Pursuit(Target((5.0, 1.0)), world.robot)
    assert go(world, pursuit, traversable) == 0
    assert not pursuit.reached


def test_gives_up_when_the_robot_does_not_move(world):
    space = world.free_space()
    pursuit = Pursuit(Target((5.0, 1.0)), world.robot, patience=12)
    actions = 0
    while pursuit.act(world.pose, space.free, space.frame) is not None:
        actions += 1
    assert actions == 13, "one action that counts as progress, then the patience"
    assert not pursuit.reached


def test_plans_anew_when_the_map_shows_that_the_path_is_blocked(world):
    space = world.free_space()
    knows_no_wall = np.ones(space.frame.shape, bool)
    pursuit = Pursuit(Target((5.0, 1.0)), world.robot)
    for _ in range(3):
        world.step(pursuit.act(world.pose, knows_no_wall, space.frame))
    assert go(world, pursuit) > 30
    assert pursuit.reached
