import numpy as np
import pytest
from scipy import ndimage

from deux.mapping.planning import distance_field
from deux.mapping.traversable import approaches, process_map, unknown_beside


@pytest.mark.parametrize("clearance", [1.0, 2.5, 3.0])
def test_obstacles_grow_by_the_clearance_as_by_an_exact_distance_transform(clearance):
    cells = np.random.default_rng(1).choice([1, 2], size=(60, 70), p=[0.02, 0.98]).astype(np.int8)
    distance = ndimage.distance_transform_edt(cells != 1)
    assert np.array_equal(process_map(cells, clearance, []), distance > clearance)


def test_the_unknown_is_traversable_only_when_asked():
    cells = np.full((9, 9), 2, np.int8)
    cells[:, 5:] = 0
    assert not process_map(cells, 2.0, [])[:, 5:].any()
    assert process_map(cells, 2.0, [], unknown_is_traversable=True).all()


def test_growth_is_taken_back_around_the_robot_but_obstacles_are_not():
    cells = np.full((11, 11), 2, np.int8)
    cells[5, 6] = 1
    assert not process_map(cells, 2.0, [])[5, 5]
    freed = process_map(cells, 2.0, [(5, 5)])
    assert freed[5, 5]
    assert not freed[5, 6]


def test_a_place_to_look_from_is_the_nearest_that_can_be_reached_and_sees_the_cell():
    traversable = np.ones((12, 12), bool)
    traversable[:, 5:8] = False
    open_cells = np.ones((12, 12), bool)
    open_cells[:, 6] = False
    distance = distance_field(traversable, (0, 0))
    places, lengths = approaches(open_cells, distance, np.array([[4, 5], [4, 8], [3, 3]]), 4)
    assert places[0].tolist() == [4, 4]
    assert lengths[0] == pytest.approx(4 * np.sqrt(2.0))
    assert np.isinf(lengths[1]), "a frontier behind a wall has no place on this side of it"
    assert places[2].tolist() == [3, 3]


def test_the_unknown_beside_a_frontier_is_on_its_far_side():
    cells = np.full((20, 20), 2, np.int8)
    cells[:, 12:] = 0
    assert unknown_beside(cells, 10, 11, 3) == (10.0, 12.0)
    assert unknown_beside(cells, 10, 4, 3) is None
