"""Floor plans on a grid of 0.25 m that are covered in part."""

import numpy as np

from deux.scenes.cover import inside_building

CELL = 0.25


def plan(covered_part, shape=(80, 100), floor=True):
    """A floor plan that is covered in a part of it (row and column slices)."""
    covered = np.zeros(shape, bool)
    covered[covered_part] = True
    return np.full(shape, floor), covered


def test_a_house_in_a_garden_is_what_is_covered():
    floor, covered = plan(np.s_[20:40, 30:60])
    np.testing.assert_array_equal(inside_building(floor, covered, CELL), covered)


def test_everything_is_inside_where_all_is_covered_and_nothing_where_nothing_is():
    floor, covered = plan(np.s_[:, :])
    np.testing.assert_array_equal(inside_building(floor, covered, CELL), floor)
    assert inside_building(floor, ~covered, CELL) is None


def test_a_ceiling_with_holes_covers_what_is_below_them():
    """A slit of 0.75 m from the outside, and a skylight of 2.5 m2 in the middle."""
    floor, covered = plan(np.s_[20:60, 20:80])
    covered[30:33, 20:50] = False
    covered[45:50, 40:48] = False
    inside = inside_building(floor, covered, CELL)
    assert inside is not None
    assert inside[45:50, 40:48].all()
    assert inside[30:33, 25:50].all()
    assert not inside[:19].any()
    assert not inside[:, :19].any()


def test_a_large_courtyard_is_outside():
    floor, covered = plan(np.s_[20:60, 20:80])
    covered[30:50, 35:65] = False
    inside = inside_building(floor, covered, CELL)
    assert inside is not None
    assert not inside[38:42, 45:55].any()


def test_a_few_covered_spots_make_no_building():
    """Lamps and shelves of an open scan: 4 % of the floor, no spot larger than 2 m2."""
    floor, covered = plan(np.s_[10:15, 10:16])
    covered[50:56, 70:75] = covered[30:34, 40:48] = True
    assert inside_building(floor, covered, CELL) is None


def test_a_scattered_canopy_makes_no_building():
    """Strips of 2 m over every 8 m of a large floor, joined at one end: a frame, not a house."""
    floor, covered = plan(np.s_[0:4, :], shape=(400, 400))
    covered[:, ::40] = True
    assert inside_building(floor, covered, CELL) is None
