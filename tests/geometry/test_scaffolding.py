import numpy as np
import pytest
from scipy.interpolate import griddata

from deux.geometry.scaffolding import interpolate


def sparse_of(dense: np.ndarray, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    sparse = np.zeros_like(dense)
    chosen = rng.choice(dense.size, count, replace=False)
    sparse.flat[chosen] = dense.flat[chosen]
    return sparse


def test_a_plane_is_recovered_exactly_inside_the_hull():
    rows, columns = np.indices((40, 50))
    plane = (1.0 + 0.02 * rows + 0.03 * columns).astype(np.float32)
    inside = interpolate(sparse_of(plane, 60), outside="zero")
    assert (inside > 0).mean() > 0.7
    np.testing.assert_allclose(inside[inside > 0], plane[inside > 0], rtol=1e-5)


def test_agrees_with_griddata():
    dense = np.random.default_rng(1).uniform(0.5, 5.0, (30, 30)).astype(np.float32)
    sparse = sparse_of(dense, 40)
    points = np.argwhere(sparse > 0)
    expected = griddata(points, sparse[sparse > 0], tuple(np.indices(sparse.shape)), fill_value=0.0)
    np.testing.assert_allclose(interpolate(sparse, outside="zero"), expected, atol=1e-5)


@pytest.mark.parametrize("points", [[(3, 4)], [(3, 4), (7, 9)], [(1, 1), (5, 5), (9, 9)], [(0, 0), (0, 11), (0, 5)]])
def test_too_few_or_collinear_points_give_the_nearest_depth(points):
    sparse = np.zeros((12, 12), np.float32)
    for depth, point in enumerate(points, start=1):
        sparse[point] = depth
    dense = interpolate(sparse)
    assert set(np.unique(dense)) <= set(range(1, len(points) + 1))
    for point in points:
        assert dense[point] == sparse[point]


def test_without_points_everything_is_zero():
    assert not interpolate(np.zeros((5, 6), np.float32)).any()


def test_outside_the_hull_the_nearest_point_counts():
    sparse = np.zeros((20, 20), np.float32)
    sparse[10, 8], sparse[10, 12], sparse[13, 10] = 1.0, 2.0, 3.0
    dense = interpolate(sparse)
    assert dense[0, 0] == 1.0
    assert dense[0, 19] == 2.0
    assert dense[19, 10] == 3.0


def test_points_on_the_border_of_the_image_and_in_its_corners():
    sparse = np.zeros((9, 13), np.float32)
    rows, columns = np.array([0, 0, 8, 8, 0, 4]), np.array([0, 12, 0, 12, 6, 12])
    sparse[rows, columns] = 1.0 + 0.1 * rows + 0.2 * columns
    everywhere = 1.0 + 0.1 * np.arange(9)[:, None] + 0.2 * np.arange(13)
    for outside in ("nearest", "zero"):
        np.testing.assert_allclose(interpolate(sparse, outside), everywhere, rtol=1e-6)


@pytest.mark.parametrize("points", [[(3, 4)], [(1, 1), (5, 5), (9, 9)]])
def test_without_a_triangle_nothing_lies_outside(points):
    sparse = np.zeros((12, 12), np.float32)
    for point in points:
        sparse[point] = 2.5
    assert (interpolate(sparse, outside="zero") == 2.5).all()
