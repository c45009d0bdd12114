"""Rendering of an indoor point cloud, seen obliquely from above without ceilings."""

import cv2
import numpy as np

from deux.geometry.point_cloud import PointCloud

ELEVATION = 55.0
"""Elevation of the camera in degrees."""

CUT = 1.9
"""Height above the floor, the 2nd percentile of the heights, at which points are cut off, in metres."""

_LONGER_SIDE = 1000
"""Longer side of the image in pixels; it is rendered at twice the size and downsampled."""

_BACKGROUND = 255


def draw_cloud(cloud: PointCloud, up: np.ndarray) -> np.ndarray:
    """Draw a point cloud in parallel projection, with its longest horizontal direction from left to right.

    Args:
        cloud: the point cloud, with at least one point.
        up: direction against gravity, 3 values of any norm.

    Returns:
        H x W x 3 uint8 on a white background.
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
    # Percentiles, since a few outliers would make the rest small.
    left, rightmost = np.percentile(across, (0.2, 99.8))
    bottom, top = np.percentile(upwards, (0.2, 99.8))
    scale = 2 * _LONGER_SIDE / max(rightmost - left, top - bottom, 0.1)
    shape = (int((top - bottom) * scale) + 2, int((rightmost - left) * scale) + 2)
    order = np.argsort(nearness, kind="stable")  # painter's algorithm
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
    """Horizontal unit vector of the largest variance of the points."""
    level = points - points.mean(axis=0)
    level -= np.outer(level @ up, up)
    # Also defined without any variance: any vector of the plane is valid.
    _, vectors = np.linalg.eigh(level.T @ level - 1e12 * np.outer(up, up))
    return vectors[:, -1]


def _spacing(count: int, across: np.ndarray, upwards: np.ndarray) -> float:
    """Distance of neighbouring points if they were evenly distributed over the image, at most 0.03 m."""
    area = max(np.ptp(across) * np.ptp(upwards), 1e-6)
    return min(0.03, float(np.sqrt(area / count)))
