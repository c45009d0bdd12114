import numpy as np
import pytest
from scipy import ndimage

from deux.errors import DeuxError
from deux.geometry.grid import FreeSpace, GridFrame
from deux.simulator.starts import random_starts


def room(rows: int, columns: int) -> FreeSpace:
    inside = np.zeros((rows + 2, columns + 2), dtype=bool)
    inside[1:-1, 1:-1] = True
    clearance = (ndimage.distance_transform_edt(inside) * 0.05).astype(np.float32)
    return FreeSpace(GridFrame(-3.0, 5.0, rows + 2, columns + 2, 0.05), clearance > 0.1, clearance, 0.0)


@pytest.mark.parametrize("space", [room(40, 60), room(7, 40)])
def test_starts_are_free_roomy_and_spread(space: FreeSpace) -> None:
    starts = random_starts(space, 500, np.random.default_rng(0))
    x, z, yaw = np.array(starts).T
    rows, columns = space.frame.cells(x, z)
    assert space.free[rows, columns].all()
    median = np.median(space.clearance[space.free])
    assert space.clearance[rows, columns].min() >= min(0.3, median)
    assert len(set(zip(rows, columns, strict=True))) > 30
    assert len(set(x)) == 500
    assert np.histogram(yaw, 4, (-np.pi, np.pi))[0].min() > 80


def test_the_generator_decides() -> None:
    first, second, other = (random_starts(room(20, 20), 5, np.random.default_rng(seed)) for seed in (3, 3, 4))
    assert first == second != other


def test_a_floor_without_a_free_cell_is_reported() -> None:
    space = room(2, 2)
    assert not space.free.any()
    with pytest.raises(DeuxError, match="none of the 4 x 4 cells of the free space is free: the robot fits nowhere"):
        random_starts(space, 1, np.random.default_rng(0))
