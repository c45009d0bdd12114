"""A picture of a point cloud of rooms, seen from above at a slant with the ceilings cut away."""

import cv2
import numpy as np

from deux.geometry.point_cloud import PointCloud

ELEVATION = 55.0
"""Degrees above the horizon from which the cloud is seen."""

CUT = 1.9
"""Metres above the floor from which on points are left out; the floor is the 2nd percentile of the heights."""

_LONGER_SIDE = 1000
"""Pixels of the picture, drawn at twice as many and scaled down."""

_BACKGROUND = 255


def draw_cloud(cloud: PointCloud, up: np.ndarray) -> np.ndarray:
    """Draw a cloud in parallel projection, its longest horizontal direction from left to right.

    Args:
        cloud: at least one point.
        up: 3, the direction against gravity, of any length.

    Returns:
        H x W x 3 uint8 on white.
    """
    up = up / np.linalg.norm(up)
    heights = cloud.points @ up
    kept = heights <= np.percentile(heights, 2) + CUT
    points, colors = cloud.points[kept].astype(np.float64), cloud.colors[kept]
    right = _longest_direction(points, up)
    away = np.cross(up, right)
    sine, cosine = np.sin(np.radians(ELEVATION)), np.cos(np.radians(ELEVATION))
    across, upwards = points @ right, points @ (sine * away + cosine * up)
    nearness = points @ (sine * up - cosine * away)
    # Far ends that a few wrong points make would leave the rest small.
    left, rightmost = np.percentile(across, (0.2, 99.8))
    bottom, top = np.percentile(upwards, (0.2, 99.8))
    scale = 2 * _LONGER_SIDE / max(rightmost - left, top - bottom, 0.1)
    shape = (int((top - bottom) * scale) + 2, int((rightmost - left) * scale) + 2)
    order = np.argsort(nearness, kind="stable")  # what is nearer is drawn over what is farther
    columns = np.rint((across[order] - left) * scale).astype(np.int64)
    rows = np.rint((top - upwards[order]) * scale).astype(np.int64)
    picture = np.full((*shape, 3), _BACKGROUND, np.uint8)
    size = max(2, round(2.0 * scale * _spacing(len(points), across, upwards)))
    down, aside = (offset.ravel() for offset in np.indices((size, size)))
    rows, columns = (rows[:, None] + down).ravel(), (columns[:, None] + aside).ravel()
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    picture[rows[inside], columns[inside]] = colors[order].repeat(size * size, axis=0)[inside]
    return cv2.resize(picture, (max(1, shape[1] // 2), max(1, shape[0] // 2)), interpolation=cv2.INTER_AREA)


def _longest_direction(points: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The horizontal unit vector along which the points spread the most."""
    level = points - points.mean(axis=0)
    level -= np.outer(level @ up, up)
    # Also defined where the points spread nowhere: any vector of the plane will do.
    _, vectors = np.linalg.eigh(level.T @ level - 1e12 * np.outer(up, up))
    return vectors[:, -1]


def _spacing(count: int, across: np.ndarray, upwards: np.ndarray) -> float:
    """Metres between neighbouring points if they were spread evenly over the picture, at most 3 cm."""
    area = max(np.ptp(across) * np.ptp(upwards), 1e-6)
    return min(0.03, float(np.sqrt(area / count)))
