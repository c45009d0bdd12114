"""Coloured points in space from depth maps, and their fusion on a grid of voxels."""

from typing import NamedTuple

import numpy as np

_MOST_PENDING = 4_000_000
"""Points that wait to be merged at most; merging sorts all voxels, so it is done seldom."""

_REACH = 1 << 20
"""Voxels on either side of the origin: three coordinates of 21 bits make one key of 63."""


class PointCloud(NamedTuple):
    """Points with colours.

    Args:
        points: N x 3 float32 metres.
        colors: N x 3 uint8.
    """

    points: np.ndarray
    colors: np.ndarray


def unproject(depth: np.ndarray, intrinsics: np.ndarray, pose: np.ndarray | None = None) -> np.ndarray:
    """The point of every pixel, X = R (d K^-1 (u, v, 1)) + t.

    Args:
        depth: H x W metres.
        intrinsics: 3 x 3, for pixel centres at integers.
        pose: 4 x 4 camera-to-world; None leaves the points in camera axes.

    Returns:
        H x W x 3 float64 metres.

    Example:
        >>> unproject(np.array([[2.0, 2.0]]), np.eye(3)).tolist()
        [[[0.0, 0.0, 2.0], [2.0, 0.0, 2.0]]]
    """
    height, width = depth.shape
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1).astype(np.float64)
    points = (pixels @ np.linalg.inv(intrinsics).T) * depth[..., None]
    return points if pose is None else points @ pose[:3, :3].T + pose[:3, 3]


class VoxelFusion:
    """Merges points by voxels: each voxel that was hit gives one point, the mean of its points and of their colours.

    Memory grows with the voxels and not with the points. Voxels reach 2^20 of their edges from the origin, 21 km for
    2 cm; points beyond that are left out.

    Args:
        voxel: edge of a voxel in metres; 0 keeps all points.
    """

    def __init__(self, voxel: float) -> None:
        self._voxel = voxel
        self._pending: list[tuple[np.ndarray, np.ndarray]] = []
        self._count = 0
        self._merged = _Voxels(np.empty(0, np.int64), np.empty((0, 6)), np.empty(0, np.int64))

    def add(self, points: np.ndarray, colors: np.ndarray) -> None:
        """Add N x 3 metres with N x 3 uint8."""
        if len(points) == 0:
            return
        self._pending.append((points.astype(np.float32 if self._voxel == 0 else np.float64), colors))
        self._count += len(points)
        if self._voxel > 0 and self._count > _MOST_PENDING:
            self._merge()

    def cloud(self) -> PointCloud:
        """The points so far."""
        if self._voxel == 0:
            points = [np.empty((0, 3), np.float32), *(points for points, _ in self._pending)]
            colors = [np.empty((0, 3), np.uint8), *(colors for _, colors in self._pending)]
            return PointCloud(np.concatenate(points), np.concatenate(colors))
        self._merge()
        means = self._merged.sums / self._merged.counts[:, None]
        return PointCloud(means[:, :3].astype(np.float32), np.rint(means[:, 3:]).astype(np.uint8))

    def _merge(self) -> None:
        if not self._pending:
            return
        points, colors = (np.concatenate(parts) for parts in zip(*self._pending, strict=True))
        cells = np.floor(points / self._voxel) + _REACH
        inside = ((cells >= 0) & (cells < 2 * _REACH)).all(axis=1)
        new_keys = cells[inside].astype(np.int64) @ np.array([4 * _REACH * _REACH, 2 * _REACH, 1])
        keys = np.concatenate([self._merged.keys, new_keys])
        sums = np.concatenate([self._merged.sums, np.concatenate([points, colors], axis=1)[inside]])
        counts = np.concatenate([self._merged.counts, np.ones(len(new_keys), np.int64)])
        self._pending, self._count = [], 0
        if len(keys) == 0:
            return
        order = np.argsort(keys, kind="stable")
        keys, sums, counts = keys[order], sums[order], counts[order]
        first = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
        self._merged = _Voxels(keys[first], np.add.reduceat(sums, first), np.add.reduceat(counts, first))


class _Voxels(NamedTuple):
    """Voxels that were hit: the key of each, V, the sums of points and colours, V x 6, and how many points, V."""

    keys: np.ndarray
    sums: np.ndarray
    counts: np.ndarray
