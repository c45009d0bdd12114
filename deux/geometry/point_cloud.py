"""Coloured point clouds from depth maps, and their fusion on a voxel grid."""

from typing import NamedTuple

import numpy as np

_MOST_PENDING = 4_000_000
"""Maximum number of points that are buffered before merging, which sorts all voxels."""

_REACH = 1 << 20
"""Number of voxels on either side of the origin: three coordinates of 21 bits make one key of 63 bits."""


class PointCloud(NamedTuple):
    """A coloured point cloud.

    Args:
        points: N x 3 float32 metres.
        colors: N x 3 uint8.
    """

    points: np.ndarray
    colors: np.ndarray


def unproject(depth: np.ndarray, intrinsics: np.ndarray, pose: np.ndarray | None = None) -> np.ndarray:
    """Back-project every pixel, X = R (d K^-1 (u, v, 1)) + t.

    Args:
        depth: H x W metres.
        intrinsics: 3 x 3, for pixel centres at integers.
        pose: 4 x 4 camera-to-world; None returns points in camera axes.

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
    """Voxel-grid downsampling: all points of a voxel become one, with their mean position and colour.

    The memory grows with the number of voxels, not of points. The grid extends 2^20 voxels from the origin, 21 km for
    voxels of 2 cm; points beyond it are ignored.

    Args:
        voxel: edge of a voxel in metres; 0 keeps all points.
    """

    def __init__(self, voxel: float) -> None:
        self._voxel = voxel
        self._pending: list[tuple[np.ndarray, np.ndarray]] = []
        self._count = 0
        self._merged = _Voxels(np.empty(0, np.int64), np.empty((0, 6)), np.empty(0, np.int64))

    def add(self, points: np.ndarray, colors: np.ndarray) -> None:
        """Add points, N x 3 metres, with their colours, N x 3 uint8."""
        if len(points) == 0:
            return
        self._pending.append((points.astype(np.float32 if self._voxel == 0 else np.float64), colors))
        self._count += len(points)
        if self._voxel > 0 and self._count > _MOST_PENDING:
            self._merge()

    def cloud(self) -> PointCloud:
        """The fused points."""
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
    """Occupied voxels: keys, V; sums of positions and colours, V x 6; and numbers of points, V."""

    keys: np.ndarray
    sums: np.ndarray
    counts: np.ndarray
