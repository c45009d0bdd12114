import numpy as np
import pytest

from deux.mapping.frontiers import find_frontiers, frontier_mask


def frontier_cells_by_definition(cells):
    found = set()
    rows, columns = cells.shape
    for row in range(rows):
        for column in range(columns):
            if cells[row, column] != 2:
                continue
            for to in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
                if 0 <= to[0] < rows and 0 <= to[1] < columns and cells[to] == 0:
                    found.add((row, column))
    return found


def clusters_by_flood_fill(points):
    points, clusters = set(points), []
    while points:
        stack, cluster = [points.pop()], set()
        while stack:
            row, column = stack.pop()
            cluster.add((row, column))
            near = {(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} & points
            points -= near
            stack += near
        clusters.append(frozenset(cluster))
    return clusters


@pytest.mark.parametrize("seed", range(30))
def test_agrees_with_the_definition_on_random_grids(seed):
    rng = np.random.default_rng(seed)
    cells = rng.choice(3, size=rng.integers(1, 40, 2), p=[0.3, 0.2, 0.5]).astype(np.int8)
    expected = frontier_cells_by_definition(cells)
    assert {tuple(cell) for cell in np.argwhere(frontier_mask(cells))} == expected
    for min_size in (1, 4):
        found = [frozenset(map(tuple, cluster)) for cluster in find_frontiers(cells, min_size)]
        assert set(found) == {c for c in clusters_by_flood_fill(expected) if len(c) >= min_size}
        assert len(found) == len(set(found))
        sizes = [len(cluster) for cluster in found]
        assert sizes == sorted(sizes, reverse=True)


def test_a_fully_known_map_has_no_frontier():
    cells = np.full((5, 6), 2, np.int8)
    cells[2, 2] = 1
    assert find_frontiers(cells) == []


def test_cells_that_do_not_count_divide_a_frontier():
    cells = np.full((9, 4), 2, np.int8)
    cells[:, 0] = 0
    without = np.zeros(cells.shape, bool)
    without[3, 1] = without[3, 2] = True
    assert [len(cluster) for cluster in find_frontiers(cells, 1, without)] == [5, 3]
