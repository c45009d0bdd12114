import math

import numpy as np
import pytest

from deux.geometry.grid import GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.finished_frontiers import FinishedFrontiers

FRAME = GridFrame(-1.0, -2.0, 40, 60)
TARGET = FRAME.centre(20, 30)
"""On the frontier; the free floor is below it (greater rows, greater z)."""


@pytest.fixture
def cells():
    """Free floor below row 20, and the unknown above it."""
    made = np.full(FRAME.shape, 2, np.int8)
    made[:20] = 0
    return made


@pytest.fixture
def finished():
    return FinishedFrontiers(reach=0.3, field_of_view=math.pi / 2.0)


def columns(mask):
    rows, found = np.nonzero(mask)
    assert set(rows) <= {20}
    return set(found)


def looking(row, column, degrees):
    """The camera's pose at a cell; 0 degrees looks up the rows, at the frontier, and more turns left."""
    x, z = FRAME.centre(row, column)
    return camera_pose(x, 1.25, z, math.radians(degrees))


def test_nothing_is_finished_at_first(cells, finished):
    assert not finished.mask(FRAME).any()
    assert finished.any_left(cells, FRAME, TARGET)


def test_looking_finishes_what_is_within_reach_and_in_the_picture(cells, finished):
    finished.finish(cells, FRAME, TARGET, looking(24, 30, 0.0))
    assert columns(finished.mask(FRAME)) == set(range(27, 34)), "45 degrees to each side at a distance of 4 cells"


def test_a_look_the_other_way_finishes_the_target_only(cells, finished):
    finished.finish(cells, FRAME, TARGET, looking(24, 30, 180.0))
    assert columns(finished.mask(FRAME)) == {30}


def test_a_target_that_was_not_reached_is_finished_with_all_that_is_near(cells, finished):
    finished.finish(cells, FRAME, TARGET, None)
    assert columns(finished.mask(FRAME)) == set(range(24, 37))
    assert not finished.any_left(cells, FRAME, TARGET)
    assert finished.any_left(cells, FRAME, FRAME.centre(20, 32)), "two cells of the frontier are new within its reach"


def test_the_frontier_on_the_other_side_of_a_wall_is_not_finished(cells, finished):
    cells[18:, 32] = 1
    finished.finish(cells, FRAME, TARGET, looking(24, 30, 0.0))
    assert columns(finished.mask(FRAME)) == set(range(27, 32))
    finished.finish(cells, FRAME, TARGET, None)
    assert columns(finished.mask(FRAME)) == set(range(24, 32))


def test_a_target_that_is_no_frontier_any_more_is_not_chosen_when_it_comes_back(cells, finished):
    finished.finish(np.full_like(cells, 2), FRAME, TARGET, None)
    assert columns(finished.mask(FRAME)) == {30}


def test_finished_cells_stay_where_they_are_when_the_map_grows(cells, finished):
    finished.finish(cells, FRAME, TARGET, None)
    grown = GridFrame(-1.0 - 7 * 0.05, -2.0 - 3 * 0.05, 60, 90)
    assert np.array_equal(finished.mask(grown)[3:43, 7:67], finished.mask(FRAME))
    assert finished.mask(grown).sum() == 13
