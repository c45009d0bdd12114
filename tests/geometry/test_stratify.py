import numpy as np
import pytest

from deux.errors import DeuxError
from deux.geometry.stratify import stratify


def test_parts_of_the_floor_are_equal_and_cover_it() -> None:
    free = np.random.default_rng(0).random((31, 47)) < 0.7
    parts = stratify(free, 13)
    sizes = [len(part) for part in parts]
    assert max(sizes) - min(sizes) <= 1
    covered = np.zeros_like(free, dtype=int)
    np.add.at(covered, tuple(np.concatenate(parts).T), 1)
    np.testing.assert_array_equal(covered, free)


def test_more_parts_than_cells_still_has_a_cell_in_each() -> None:
    free = np.zeros((4, 4), bool)
    free[1, 1:3] = True
    assert all(len(part) == 1 for part in stratify(free, 7))


def test_an_empty_floor_is_an_error() -> None:
    with pytest.raises(DeuxError, match="no free floor"):
        stratify(np.zeros((4, 4), bool), 3)
