import numpy as np
import pytest

from deux.geometry.grid import GridFrame
from deux.mapping.frontier_targets import cell_centres, frontier_candidates, frontier_target
from deux.mapping.planning import distance_field
from deux.mapping.traversable import process_map

FRAME = GridFrame(-1.0, -2.0, 40, 60)


@pytest.fixture
def cells():
    """Free floor with the unknown on its left and right ends, the right end behind a wall."""
    made = np.full(FRAME.shape, 2, np.int8)
    made[:, :5] = 0
    made[:, 55:] = 0
    made[:, 40:42] = 1
    return made


def candidates(cells, finished=None):
    distance = distance_field(process_map(cells, 3.0, []), (20, 20))
    return frontier_candidates(cells, FRAME, distance, 4, 0.3, finished)


def test_only_frontiers_that_can_be_reached_are_candidates(cells):
    found = candidates(cells)
    assert {tuple(cell) for cell in found.cells} == {(row, 5) for row in range(40)}
    assert np.isfinite(found.lengths).all()


def test_finished_cells_are_left_out_and_what_little_remains_beside_them(cells):
    finished = np.zeros(cells.shape, bool)
    finished[:20, 5] = finished[23, 5] = True
    found = candidates(cells, finished)
    assert {tuple(cell) for cell in found.cells} == {(row, 5) for row in range(24, 40)}


def test_cell_centres_agree_with_the_frame():
    cells = np.array([[0, 0], [39, 59], [7, 31]])
    assert np.allclose(cell_centres(FRAME, cells), [FRAME.centre(*cell) for cell in cells])


def test_a_frontier_target_looks_at_the_unknown(cells):
    found = candidates(cells)
    target = frontier_target(cells, FRAME, found.cells[20], found.places[20], 0.3)
    assert target.look_at is not None
    assert target.look_at[0] < target.place[0]


def test_far_frontiers_of_some_size_are_preferred_and_all_where_there_is_none(cells):
    cells[18:23, 22:24] = 0  # a small gap next to the robot, of fewer frontier cells than the end of the floor
    found = candidates(cells)
    near = found.lengths < 8.0
    assert near.any()
    assert not near.all()
    preferred = found.preferred(least_length=8.0, least_size=1)
    assert {tuple(cell) for cell in preferred.cells} == {tuple(cell) for cell in found.cells[~near]}
    large = found.preferred(least_length=0.0, least_size=30)
    assert {tuple(cell) for cell in large.cells} == {(row, 5) for row in range(40)}
    assert len(found.preferred(least_length=1000.0, least_size=1)) == len(found)
