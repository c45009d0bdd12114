"""Points of each kind: how many, where they lie, and how wrong they are."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from deux.collection.point_patterns import OUTLIER_FACTOR, PATTERNS, Pattern, disturb, draw_points

HEIGHT, WIDTH = 90, 120


@pytest.fixture
def image() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)


@pytest.fixture
def depth() -> np.ndarray:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return (1.0 + 0.01 * rows + 0.02 * columns).astype(np.float32)


def places(sparse: np.ndarray) -> np.ndarray:
    return np.argwhere(sparse > 0)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("count", [1, 11, 108, 540])
def test_there_are_as_many_points_as_asked_for(pattern: Pattern, count: int, image: np.ndarray, depth: np.ndarray):
    drawn = [draw_points(pattern, image, depth, count, np.random.default_rng(seed)) for seed in range(20)]
    for sparse in drawn:
        np.testing.assert_array_equal(sparse[sparse > 0], depth[sparse > 0])
    mean = np.mean([np.count_nonzero(sparse) for sparse in drawn])
    exact = pattern in ("corners", "uniform", "clusters")
    assert mean == count if exact else abs(mean - count) < 0.15 * count + 1


@pytest.mark.parametrize("pattern", PATTERNS)
def test_no_point_lies_where_there_is_no_depth(pattern: Pattern, image: np.ndarray, depth: np.ndarray):
    depth[:, 40:] = 0.0
    sparse = draw_points(pattern, image, depth, 200, np.random.default_rng(1))
    assert np.count_nonzero(sparse) > 30
    assert not sparse[:, 40:].any()
    assert not draw_points(pattern, image, np.zeros_like(depth), 200, np.random.default_rng(1)).any()


@pytest.mark.parametrize("pattern", PATTERNS)
def test_equal_seeds_give_equal_points_and_others_do_not(pattern: Pattern, image: np.ndarray, depth: np.ndarray):
    one, again, other = (draw_points(pattern, image, depth, 60, np.random.default_rng(seed)) for seed in (2, 2, 3))
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()


def test_patterns_lie_as_they_are_called(image: np.ndarray, depth: np.ndarray):
    """By the distance to the nearest neighbour, in units of that of a square grid."""
    count = 108
    spacing = np.sqrt(HEIGHT * WIDTH / count)
    nearest, spread = {}, {}
    for pattern in PATTERNS:
        found = places(draw_points(pattern, image, depth, count, np.random.default_rng(4)))
        distances = KDTree(found).query(found, k=2)[0][:, 1] / spacing
        nearest[pattern], spread[pattern] = np.median(distances), np.std(distances)
    assert nearest["grid"] == pytest.approx(1.0, abs=0.1)
    assert spread["grid"] < 0.1
    assert nearest["clusters"] < nearest["uniform"] < 0.75  # 0.5 on average where points lie anywhere
    assert nearest["lines"] == pytest.approx(1 / np.sqrt(3.0), abs=0.1)


def test_scan_lines_are_few_rows_far_apart(image: np.ndarray, depth: np.ndarray):
    found = places(draw_points("lines", image, depth, 300, np.random.default_rng(5)))
    slope_free = KDTree(found).query_ball_point(found, r=9.0)
    # All neighbours within less than the distance of two lines lie along the same, nearly level line.
    rows = np.array([np.ptp(found[group, 0]) for group in slope_free])
    assert np.median(rows) <= 2


def test_noise_has_the_deviation_asked_for(depth: np.ndarray):
    disturbed = disturb(depth, 0.03, 0.0, np.random.default_rng(6))
    assert np.std(disturbed / depth - 1.0) == pytest.approx(0.03, rel=0.05)
    np.testing.assert_array_equal(disturb(depth, 0.0, 0.0, np.random.default_rng(6)), depth)


def test_outliers_are_the_fraction_asked_for(depth: np.ndarray):
    ratio = disturb(depth, 0.0, 0.04, np.random.default_rng(7)) / depth
    wrong = np.abs(ratio - 1.0) > 1e-6
    assert np.mean(wrong) == pytest.approx(0.04, abs=1e-4)
    assert ratio.min() > 1 / OUTLIER_FACTOR - 1e-6
    assert ratio.max() < OUTLIER_FACTOR + 1e-6
    assert (ratio[wrong] < 1).mean() == pytest.approx(0.5, abs=0.1)
