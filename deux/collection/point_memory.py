"""The sparse depth points of a robot's latest frames, projected into its current view."""

from collections import deque

import numpy as np
from scipy.ndimage import minimum_filter

from deux.geometry.point_cloud import unproject
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
        measured = sparse_depth > 0.0
        earlier = np.concatenate([np.empty((0, 3)), *self._points])
        self._points.append(unproject(sparse_depth, intrinsics, pose)[measured])
        merged = np.where(measured, sparse_depth, _project(earlier, sparse_depth.shape, pose, intrinsics))
        hidden = merged > minimum_filter(merged, _WINDOW, mode="nearest") + _HIDDEN
        return np.where(np.isfinite(merged) & (measured | ~hidden), merged, 0.0).astype(np.float32)


def _project(points: np.ndarray, shape: tuple[int, ...], pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """The depth of the nearest of N x 3 points at each pixel, H x W float32 metres; inf without a point."""
    height, width = shape
    local = np.c_[points, np.ones(len(points))] @ inverse(pose)[:3].T
    local = local[local[:, 2] > 0.0]
    columns, rows, _ = np.rint(local @ intrinsics.T / local[:, 2:]).T
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    depth = np.full(shape, np.inf, np.float32)
    pixels = rows[inside].astype(np.int64), columns[inside].astype(np.int64)
    np.minimum.at(depth, pixels, local[inside, 2].astype(np.float32))
    return depth
