"""Pictures of clouds: what is seen from above, and what is cut away."""

import numpy as np
import pytest

from deux.figures.cloud_view import draw_cloud
from deux.geometry.point_cloud import PointCloud

FLOOR, TABLE, CEILING = (200, 0, 0), (0, 200, 0), (0, 0, 200)


def slab(width: float, length: float, height: float, color: tuple[int, int, int]) -> PointCloud:
    """A level rectangle around the axis of heights, y up, with a point in each 2 cm."""
    x, z = np.meshgrid(np.arange(-width / 2, width / 2, 0.02), np.arange(-length / 2, length / 2, 0.02))
    points = np.stack([x.ravel(), np.full(x.size, height), z.ravel()], axis=1).astype(np.float32)
    return PointCloud(points, np.tile(np.array(color, np.uint8), (len(points), 1)))


def room() -> PointCloud:
    parts = slab(6, 3, 0.0, FLOOR), slab(2, 1, 0.8, TABLE), slab(6, 3, 2.5, CEILING)
    return PointCloud(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


@pytest.mark.parametrize("axis", [1, 2])
def test_one_looks_into_the_room_along_its_longer_side(axis: int) -> None:
    """The ceiling is cut away and the table hides the floor below it, whichever way is up."""
    cloud, up = room(), np.zeros(3)
    up[axis] = 7.0
    points = cloud.points if axis == 1 else np.stack([cloud.points[:, 0], -cloud.points[:, 2], cloud.points[:, 1]], 1)
    picture = draw_cloud(PointCloud(points, cloud.colors), up).astype(int)
    height, width = picture.shape[:2]
    assert width == pytest.approx(1000, abs=5)
    assert height < 0.6 * width  # 3 m at 55 degrees and 0.8 m of height, against 6 m
    counts = {color: (np.abs(picture - color).max(axis=-1) < 40).mean() for color in (FLOOR, TABLE, CEILING)}
    assert counts[CEILING] == 0.0
    assert counts[TABLE] == pytest.approx(2 / 18, abs=0.03)
    assert counts[FLOOR] > 0.6


def test_a_single_point_is_drawn() -> None:
    picture = draw_cloud(PointCloud(np.ones((1, 3), np.float32), np.zeros((1, 3), np.uint8)), np.array([0, 1.0, 0]))
    assert picture.min() < 255
