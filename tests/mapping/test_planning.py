import itertools
import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from deux.mapping.planning import distance_field, line_is_clear, path_length, shortest_path


def explicit_graph(traversable):
    """Every legal step as an edge, built cell by cell."""
    rows, columns = traversable.shape
    sources, targets, costs = [], [], []
    for row in range(rows):
        for column in range(columns):
            for down, right in [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]:
                r, c = row + down, column + right
                if not (0 <= r < rows and 0 <= c < columns):
                    continue
                if all(traversable[i] for i in {(row, column), (r, c), (row, c), (r, column)}):
                    sources.append(row * columns + column)
                    targets.append(r * columns + c)
                    costs.append(math.hypot(down, right))
    size = rows * columns
    return coo_array((costs, (sources, targets)), shape=(size, size)).tocsr()


@pytest.mark.parametrize("seed", range(25))
def test_lengths_equal_scipys_dijkstra_on_random_grids(seed):
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(2, 35, 2))
    traversable = rng.random(shape) < rng.uniform(0.5, 0.95)
    start = tuple(int(rng.integers(n)) for n in shape)
    traversable[start] = True
    expected = dijkstra(explicit_graph(traversable), indices=start[0] * shape[1] + start[1]).reshape(shape)
    assert np.allclose(distance_field(traversable, start), np.where(traversable, expected, np.inf))
    for goal in rng.integers(0, shape, (12, 2)):
        path = shortest_path(traversable, start, tuple(goal))
        if not np.isfinite(expected[tuple(goal)]):
            assert path is None
            continue
        assert path is not None
        assert tuple(path[0]) == start
        assert tuple(path[-1]) == tuple(goal)
        assert path_length(path) == pytest.approx(expected[tuple(goal)])
        for a, b in itertools.pairwise(path):
            assert np.abs(b - a).max() == 1
            assert traversable[a[0], b[1]]
            assert traversable[b[0], a[1]]


def test_does_not_cut_a_corner():
    traversable = np.ones((2, 2), bool)
    traversable[0, 1] = False
    assert shortest_path(traversable, (0, 0), (1, 1)).tolist() == [[0, 0], [1, 0], [1, 1]]
    traversable[1, 0] = False
    assert shortest_path(traversable, (0, 0), (1, 1)) is None


def test_a_path_to_where_one_stands_is_that_one_cell():
    assert shortest_path(np.ones((3, 3), bool), (1, 2), (1, 2)).tolist() == [[1, 2]]


def test_an_end_inside_an_obstacle_has_no_path():
    traversable = np.ones((3, 3), bool)
    traversable[0, 0] = False
    assert shortest_path(traversable, (0, 0), (2, 2)) is None
    assert shortest_path(traversable, (2, 2), (0, 0)) is None
    assert np.isinf(distance_field(traversable, (0, 0))).all()


def test_a_line_is_blocked_by_a_wall_and_by_nothing_else():
    traversable = np.ones((9, 9), bool)
    traversable[:, 4] = False
    assert not line_is_clear(traversable, (1, 1), (7, 7))
    assert line_is_clear(traversable, (0, 0), (8, 3))
    assert line_is_clear(traversable, (8, 8), (0, 5))
