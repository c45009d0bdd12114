import math

import numpy as np
import pytest
from matplotlib.path import Path
from scipy import ndimage

from deux.simulator.wall_segments import is_clear, wall_segments


def hilly_floor(seed: int) -> np.ndarray:
    """Connected free cells of every shape, rows x columns bool: smooth and rough borders, holes, narrow passages."""
    rng = np.random.default_rng(seed)
    hills = ndimage.gaussian_filter(rng.normal(size=(60, 80)), rng.uniform(0.5, 4.0))
    regions, _ = ndimage.label(hills > np.quantile(hills, rng.uniform(0.1, 0.6)))
    return regions == np.bincount(regions[regions > 0]).argmax()


def loops(starts: np.ndarray, ends: np.ndarray) -> list[np.ndarray]:
    """The corners of each closed loop; every segment must begin where another one ends."""
    after = {tuple(start): number for number, start in enumerate(starts)}
    assert len(after) == len(starts)
    left, found = set(range(len(starts))), []
    while left:
        here, loop = left.pop(), []
        loop.append(here)
        while (here := after[tuple(ends[here])]) in left:
            left.remove(here)
            loop.append(here)
        assert here == loop[0]
        found.append(starts[loop])
    return found


def enclosed(starts: np.ndarray, ends: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Which cells' centres lie on the floor that the loops enclose, by the even-odd rule."""
    rows, columns = np.indices(shape)
    centres = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=1)
    inside = np.zeros(len(centres), dtype=bool)
    for loop in loops(starts, ends):
        inside ^= Path(loop).contains_points(centres)
    return inside.reshape(shape)


@pytest.mark.parametrize("seed", range(12))
def test_on_any_floor_walls_are_closed_and_enclose_free_cells_only(seed: int) -> None:
    free = hilly_floor(seed)
    starts, ends = wall_segments(free)
    fraction = np.linspace(0.0, 1.0, 200)[:, None, None]
    columns, rows = np.moveaxis(np.floor(starts + fraction * (ends - starts)).astype(int), -1, 0)
    assert free[rows, columns].all()
    inside = enclosed(starts, ends, free.shape)
    assert not (inside & ~free).any()
    # What is more than two cells from any border is inside, and the border cells are not given up.
    assert inside[ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] > 2.0].all()
    assert inside.sum() > 0.65 * free.sum()


@pytest.mark.parametrize("seed", range(12))
def test_walls_do_not_cross(seed: int) -> None:
    starts, ends = wall_segments(hilly_floor(seed))
    along = ends - starts

    def side(points: np.ndarray) -> np.ndarray:
        to = points[None] - starts[:, None]
        return np.sign(along[:, None, 0] * to[..., 1] - along[:, None, 1] * to[..., 0])

    apart = side(starts) * side(ends) < 0
    joined = (ends[:, None] == starts[None]).all(axis=-1)
    assert not (apart & apart.T & ~joined & ~joined.T).any()


def test_the_floor_is_on_the_same_side_of_all_walls() -> None:
    free = np.ones((20, 30), dtype=bool)
    free[5:15, 8:22] = False
    starts, ends = wall_segments(free)
    ux, uy = ((ends - starts) / np.linalg.norm(ends - starts, axis=1, keepdims=True)).T
    x, y = ((starts + ends) / 2.0 + 0.1 * np.stack([-uy, ux], axis=1)).T
    assert free[np.floor(y).astype(int), np.floor(x).astype(int)].all()
    assert len(starts) == 8


@pytest.mark.parametrize("degrees", range(0, 180, 7))
def test_a_straight_wall_is_one_segment_of_its_direction(degrees: int) -> None:
    angle = math.radians(degrees)
    rows, columns = np.indices((120, 120))
    free = (columns - 59.7) * math.cos(angle) + (rows - 59.7) * math.sin(angle) > 0.3
    starts, ends = wall_segments(free)
    along = (ends - starts)[np.argmin(np.abs((starts + ends) / 2.0 - 60.0).sum(axis=1))]
    assert np.linalg.norm(along) > 100.0
    error = math.remainder(math.atan2(along[1], along[0]) - angle - math.pi / 2.0, math.pi)
    assert abs(math.degrees(error)) < 0.2  # 0.8 mm of a step of 0.25 m


@pytest.mark.parametrize("bend", [False, True])
def test_passages_one_cell_wide_stay_open(bend: bool) -> None:
    free = np.zeros((30, 30), dtype=bool)
    free[2:10, 2:10] = free[20:28, 20:28] = True
    if bend:
        free[5, 10:25] = free[5:20, 24] = True
    else:
        for step in range(10, 21):
            free[step, step - 1 : step + 1] = True
        free[9, 9] = True
    starts, ends = wall_segments(free)
    (outline,) = loops(starts, ends)
    assert Path(outline).contains_points([(5.0, 5.0), (25.0, 25.0)]).all()


def test_cells_that_touch_at_a_corner_are_apart() -> None:
    free = np.zeros((20, 20), dtype=bool)
    free[2:8, 2:8] = free[8:14, 8:14] = True
    assert len(loops(*wall_segments(free))) == 2


def test_the_smallest_floors_have_walls_and_none_has_none() -> None:
    for shape in ((1, 1), (1, 2), (3, 1), (2, 2)):
        starts, ends = wall_segments(np.ones(shape, dtype=bool))
        (outline,) = loops(starts, ends)
        assert Path(outline).contains_point((shape[1] / 2.0, shape[0] / 2.0))
    assert wall_segments(np.zeros((5, 5), dtype=bool))[0].shape == (0, 2)


def test_a_way_is_clear_where_all_its_cells_are_free() -> None:
    free = np.ones((12, 12), dtype=bool)
    free[4, 3:8] = False
    rng = np.random.default_rng(0)
    for start, end in rng.uniform(0.0, 12.0, (300, 2, 2)):
        points = start + np.linspace(0.0, 1.0, 5000)[:, None] * (end - start)
        columns, rows = np.floor(points).astype(int).T
        assert is_clear(free, *start, *end) == free[rows, columns].all()
