import math
from collections import deque

import numpy as np
import pytest

from deux.contracts import Robot
from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.action_costs import action_costs
from deux.mapping.planning import distance_field

ROBOT = Robot(forward_step=0.25, turn_angle=10.0)


def corner(rows=60, columns=60):
    """A corridor, 0.6 m wide, that goes up along the left side and turns to the right at the top."""
    open_cells = np.zeros((rows, columns), bool)
    open_cells[:, :12] = True
    open_cells[:12] = True
    return open_cells, GridFrame(0.0, 0.0, rows, columns)


def fewest_actions(open_cells, frame, x, z, goal, radius=0.15):
    """Breadth-first search over the robot's real actions from (x, z, yaw 0) until it is within a radius of a point.

    States are told apart by cells of 5 cm and headings of 10 degrees.
    """
    queue, seen = deque([(x, z, 0, 0)]), set()
    while queue:
        x, z, heading, actions = queue.popleft()
        if math.hypot(x - goal[0], z - goal[1]) <= radius:
            return actions
        state = (int(z // 0.05), int(x // 0.05), heading)
        if state in seen:
            continue
        seen.add(state)
        yaw = math.radians(10.0 * heading)
        ways = [(x - 0.25 * s * math.sin(yaw), z - 0.25 * s * math.cos(yaw)) for s in (0.25, 0.5, 0.75, 1.0)]
        rows, columns = [int(w[1] // 0.05) for w in ways], [int(w[0] // 0.05) for w in ways]
        inside = min(rows + columns) >= 0 and max(rows) < frame.rows and max(columns) < frame.columns
        if inside and open_cells[rows, columns].all():
            queue.append((*ways[-1], heading, actions + 1))
        queue.append((x, z, (heading + 1) % 36, actions + 1))
        queue.append((x, z, (heading - 1) % 36, actions + 1))
    return math.inf


@pytest.mark.parametrize("goal", [(30, 5), (5, 30), (5, 50)])
def test_agrees_with_a_search_over_the_real_actions_around_a_corner(goal):
    open_cells, frame = corner()
    costs = action_costs(open_cells, frame, camera_pose(0.3, 1.25, 2.8, 0.0), ROBOT)
    true = fewest_actions(open_cells, frame, 0.3, 2.8, frame.centre(*goal))
    assert costs.to(np.array([goal]))[0] == pytest.approx(true, abs=3.0)


def test_in_the_open_it_is_the_turn_and_the_straight_line():
    frame = GridFrame(0.0, 0.0, 100, 100)
    pose = camera_pose(2.525, 1.25, 2.525, 0.0)
    ahead, behind, left = (20, 50), (80, 50), (50, 20)
    costs = action_costs(np.ones((100, 100), bool), frame, pose, ROBOT)
    assert costs.to(np.array([ahead, behind, left])) == pytest.approx([6.0, 24.0, 15.0])
    assert costs.to_views(np.array([ahead, ahead]), np.array([0.0, math.pi / 2])) == pytest.approx([6.0, 15.0], abs=0.5)


def test_facing_elsewhere_where_it_stands_costs_the_turn_alone():
    frame = GridFrame(0.0, 0.0, 40, 40)
    costs = action_costs(np.ones((40, 40), bool), frame, camera_pose(1.02, 1.25, 1.02, 0.5), ROBOT)
    assert costs.to(np.array([[20, 20]])) == pytest.approx([0.0])
    assert costs.to_views(np.array([[20, 20]]), np.array([0.5 - math.pi / 2])) == pytest.approx([9.0])


@pytest.mark.parametrize("seed", range(5))
def test_reaches_the_cells_that_paths_reach(seed):
    rng = np.random.default_rng(seed)
    open_cells = np.ones((80, 80), bool)
    for row, column in rng.integers(0, 70, (12, 2)):  # walls wider than a lattice cell
        open_cells[row : row + 6, column : column + 30] = False
    start = tuple(np.argwhere(open_cells)[0])
    frame = GridFrame(0.0, 0.0, 80, 80)
    x, z = frame.centre(*start)
    cells = np.argwhere(open_cells)
    costs = action_costs(open_cells, frame, camera_pose(x, 1.25, z, 0.0), ROBOT).to(cells)
    distance = distance_field(open_cells, start)[open_cells]
    assert np.isfinite(costs[np.isfinite(distance)]).all()
    # A straight line is the least that any path can be; a lattice cell may be entered at its near side.
    line = np.hypot(*(cells - start).T) * frame.resolution / ROBOT.forward_step
    assert (costs >= line - 2.0).all()


def test_blocked_cells_are_out_of_reach():
    open_cells = np.ones((40, 40), bool)
    open_cells[:, 20:26] = False
    costs = action_costs(open_cells, GridFrame(0.0, 0.0, 40, 40), camera_pose(0.5, 1.25, 0.5, 0.0), ROBOT)
    assert np.isinf(costs.to(np.array([[10, 22], [10, 35]]))).all()
