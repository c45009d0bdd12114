import math

import numpy as np
import pytest

from deux.mapping.field_paths import points_on_paths
from deux.mapping.planning import distance_field, shortest_path


def test_points_lie_on_shortest_paths_at_even_spacing():
    rng = np.random.default_rng(3)
    traversable = rng.random((40, 50)) > 0.25
    traversable[20, 25] = True
    distance = distance_field(traversable, (20, 25))
    goals = np.argwhere(np.isfinite(distance) & (distance > 6))[::150]
    points = points_on_paths(distance, goals, 4)
    assert set(points.goal) == set(range(len(goals)))
    for number, goal in enumerate(goals):
        own = points.cells[points.goal == number]
        path = shortest_path(traversable, (20, 25), tuple(goal))
        assert len(own) <= (len(path) - 1 + 1) / 4 + 4
        for cell in own:  # on a shortest path: the way there and the way on are together no longer than the way
            onward = distance_field(traversable, tuple(cell))[tuple(goal)]
            assert distance[tuple(cell)] + onward == pytest.approx(distance[tuple(goal)])
        ends = np.concatenate([goal[None], own[:-1]])
        assert np.array_equal(own + points.motion[points.goal == number], ends)


@pytest.mark.parametrize("goal", [(0, 60), (42, 42), (20, 52)])
def test_points_are_as_far_apart_in_every_direction(goal):
    """A diagonal move is longer than one along the grid: the rest of a move counts for the next point."""
    distance = distance_field(np.ones((64, 64), bool), (0, 0))
    points = points_on_paths(distance, np.array([goal]), 10.0)
    assert len(points.goal) == int(distance[goal] / 10.0)
    from_goal = distance[goal] - distance[tuple(points.cells.T)]
    np.testing.assert_allclose(from_goal, 10.0 * np.arange(1, len(from_goal) + 1), atol=math.sqrt(2.0))


def test_goals_that_are_the_start_or_out_of_reach_have_no_points():
    traversable = np.ones((9, 9), bool)
    traversable[4] = False
    distance = distance_field(traversable, (0, 0))
    points = points_on_paths(distance, np.array([[0, 0], [8, 8], [0, 5]]), 2)
    assert points.goal.tolist() == [2, 2]
    assert points.cells.tolist() == [[0, 3], [0, 1]]
