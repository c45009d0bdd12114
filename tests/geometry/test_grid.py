import numpy as np
import pytest

from deux.geometry.grid import FreeSpace, GridFrame

FRAME = GridFrame(origin_x=-1.0, origin_z=2.0, rows=40, columns=20, resolution=0.05)


def test_rows_run_along_z_and_columns_along_x():
    assert FRAME.shape == (40, 20)
    assert FRAME.cell(-0.99, 2.01) == (0, 0)
    assert FRAME.cell(-0.99 + 3 * 0.05, 2.01 + 7 * 0.05) == (7, 3)


def test_cell_is_moved_to_the_border_and_cells_are_not():
    assert FRAME.cell(-5.0, 100.0) == (39, 0)
    rows, columns = FRAME.cells(np.array([-5.0, -0.5]), np.array([100.0, 2.0]))
    np.testing.assert_array_equal(FRAME.contains(rows, columns), [False, True])
    assert rows[0] > 39
    assert columns[0] < 0


def test_one_point_has_the_cell_that_many_points_have():
    x, z = np.random.default_rng(0).uniform([-1.5, 1.5], [0.5, 4.5], size=(2000, 2)).T
    rows, columns = FRAME.cells(x, z)
    many = np.clip(rows, 0, FRAME.rows - 1), np.clip(columns, 0, FRAME.columns - 1)
    np.testing.assert_array_equal([FRAME.cell(*point) for point in zip(x, z, strict=True)], np.stack(many, axis=1))


def test_centre_of_a_cell_lies_in_it():
    for row, column in [(0, 0), (7, 3), (39, 19)]:
        assert FRAME.cell(*FRAME.centre(row, column)) == (row, column)
    assert FRAME.centre(0, 0) == pytest.approx((-0.975, 2.025))


def test_free_area_in_square_metres():
    free = np.zeros(FRAME.shape, dtype=bool)
    free[:10, :4] = True
    assert FreeSpace(FRAME, free, np.zeros(FRAME.shape, np.float32), 0.0).area == pytest.approx(40 * 0.05**2)


def test_a_floor_is_level_unless_its_heights_are_given():
    free = np.zeros(FRAME.shape, bool)
    free[1, 2] = free[1, 3] = True
    clearance = np.zeros(FRAME.shape, np.float32)
    level = FreeSpace(FRAME, free, clearance, 0.7)
    assert level.heights.dtype == np.float32
    np.testing.assert_array_equal(level.heights, np.where(free, np.float32(0.7), np.nan))
    steps = np.where(free, np.float32(0.9), np.float32(np.nan))
    stepped = FreeSpace(FRAME, free, clearance, 0.7, steps)
    assert stepped.height_at(*FRAME.centre(1, 3)) == pytest.approx(0.9)
    assert stepped.height_at(*FRAME.centre(1, 4)) == 0.7, "where nothing is free the floor's own height is meant"
    assert stepped.height_at(*FRAME.centre(-5, 0)) == 0.7
