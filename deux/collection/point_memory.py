"""The sparse depth points of a robot's latest frames, projected into its current view."""

from collections import deque

import cv2
import numpy as np

from deux.geometry.poses import inverse

_WINDOW = 7
"""Edge in pixels of the window in which a nearer point hides a remembered one."""

_HIDDEN = 0.3
"""Metres by which a remembered point must be farther than another one in its window to count as hidden."""


class PointMemory:
    """The sparse points of one robot's latest frames, as points in the world.

    The robot knows its poses, so what it measured earlier is also a measurement of the current view, as far as nothing
    nearer hides it now.

    Args:
        frames: number of frames whose points are remembered.
    """

    def __init__(self, frames: int) -> None:
        self._points: deque[np.ndarray] = deque(maxlen=frames)

    def add(self, sparse_depth: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
        """Remember a frame's points, and return them together with the earlier points that are visible in this frame.

        Args:
            sparse_depth: H x W float32 metres, 0 = none.
            pose: 4 x 4 camera-to-world.
            intrinsics: 3 x 3.

        Returns:
            H x W float32 metres, 0 = none: the frame's own points, and at other pixels the nearest remembered one.
        """
        rows, columns = np.nonzero(sparse_depth)
        measured = sparse_depth[rows, columns]
        earlier = np.concatenate([np.empty((0, 3)), *self._points])
        rays = np.linalg.solve(intrinsics, np.stack([columns, rows, np.ones_like(rows)]).astype(np.float64))
        self._points.append((rays * measured).T @ pose[:3, :3].T + pose[:3, 3])
        merged = _project(earlier, sparse_depth.shape, pose, intrinsics)
        merged[rows, columns] = measured
        # The nearest point of each window; outside the image, OpenCV takes infinity.
        nearest = cv2.erode(merged, np.ones((_WINDOW, _WINDOW), np.uint8))
        merged[np.isinf(merged) | (merged > nearest + _HIDDEN)] = 0.0
        merged[rows, columns] = measured
        return merged


def _project(points: np.ndarray, shape: tuple[int, ...], pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """The depth of the nearest of N x 3 points at each pixel, H x W float32 metres; inf without a point."""
    height, width = shape
    world_to_camera = inverse(pose)
    local = points @ world_to_camera[:3, :3].T + world_to_camera[:3, 3]
    local = local[local[:, 2] > 0.0]
    columns, rows, _ = np.rint(intrinsics @ (local / local[:, 2:]).T)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    depth = np.full(shape, np.inf, np.float32)
    pixels = rows[inside].astype(np.int64), columns[inside].astype(np.int64)
    np.minimum.at(depth, pixels, local[inside, 2].astype(np.float32))
    return depth
