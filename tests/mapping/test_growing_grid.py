import numpy as np
import pytest

from deux.errors import DeuxError
from deux.mapping.growing_grid import GrowingGrid


def test_values_stay_where_they_were_put_in_the_world_when_the_grid_grows_in_every_direction():
    grid = GrowingGrid(0.1, {"value": np.float32, "count": np.int64})
    points = [(0.02, 0.03), (7.34, -4.13), (-9.86, 2.25), (-3.42, 12.77), (1.05, -15.02)]
    for number, (x, z) in enumerate(points, start=1):
        grid.cover(x, z, 1.0)
        grid["value"][grid.frame.cell(x, z)] = number
        grid["count"][grid.frame.cell(x, z)] += 1
    for number, (x, z) in enumerate(points, start=1):
        assert grid["value"][grid.frame.cell(x, z)] == number
    assert grid["count"].sum() == len(points)


@pytest.mark.parametrize(("x", "z"), [(0.02, 0.03), (3.21, -8.76)])
def test_covers_the_whole_square_that_was_asked_for(x, z):
    grid = GrowingGrid(0.05, {"value": np.float32})
    grid.cover(0.0, 0.0, 0.5)
    grid.cover(x, z, 3.0)
    for dx in (-3.0, 3.0):
        for dz in (-3.0, 3.0):
            assert grid.frame.contains(*grid.frame.cells(x + dx, z + dz))


def test_cell_edges_lie_on_multiples_of_the_resolution_however_the_grid_grew():
    grid = GrowingGrid(0.05, {"value": np.float32})
    for x, z in [(0.012, 0.034), (-5.6, 3.3), (8.9, -7.7)]:
        grid.cover(x, z, 1.0)
        edges = np.array([grid.frame.origin_x, grid.frame.origin_z]) / 0.05
        assert np.allclose(edges, np.round(edges), atol=1e-9)


def test_the_arrays_are_not_copied_while_the_robot_moves_a_little():
    grid = GrowingGrid(0.05, {"value": np.float32})
    grid.cover(0.0, 0.0, 3.0)
    before = grid["value"]
    grid.cover(1.0, -1.5, 3.0)
    assert grid["value"] is before


def test_a_pose_far_away_is_refused_before_the_grid_grows_there():
    grid = GrowingGrid(0.05, {"cells": np.int8, "views": np.int32})
    grid.cover(0.0, 0.0, 3.0)
    before = grid.frame
    with pytest.raises(DeuxError, match=r"the map of .* m that the pose at x=1e\+07, z=-1e\+07 leads to would take"):
        grid.cover(1e7, -1e7, 3.0)
    assert grid.frame == before
