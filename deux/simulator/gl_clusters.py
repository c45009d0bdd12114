"""Clusters of neighbouring triangles, with frustum and occlusion culling."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from deux.compilation import compiled
from deux.contracts import SceneMesh
from deux.geometry.camera import Camera

_MARGIN = 1e-3  # metres by which bounding boxes are enlarged, more than float32 rounding errors of corners
_LARGE = 0.5  # metres; triangles with a larger bounding box count as large
_NEAREST = 0.1  # fraction of the small triangles in view that are drawn first
_TILE = 8  # pixels; edge of the tiles for occlusion culling


class Clusters(NamedTuple):
    """C clusters of neighbouring triangles, which are contiguous in a sorted order of all triangles.

    Args:
        order: F int64, the mesh's face at each position of the sorted order.
        first: C int64, the position at which each cluster begins.
        size: C int64, number of its triangles.
        large: C bool, whether its triangles are large: walls, floors and ceilings, which occlude the most.
        center: C x 3 float64, centre of its bounding box in metres.
        extent: C x 3 float64, half the size of the box.
    """

    order: np.ndarray
    first: np.ndarray
    size: np.ndarray
    large: np.ndarray
    center: np.ndarray
    extent: np.ndarray


def make_clusters(mesh: SceneMesh, most: int = 64) -> Clusters:
    """Cluster a mesh with a k-d tree: it is halved at the median of its longest axis, down to `most` triangles.

    Triangles larger than `_LARGE` are in separate clusters, because they would enlarge the boxes of small ones.
    """
    triangles = mesh.triangles
    large = np.ptp(triangles, axis=1).max(axis=1, initial=0.0) > _LARGE
    parts = [*_halve(triangles, np.flatnonzero(large), most), *_halve(triangles, np.flatnonzero(~large), most)]
    order = np.concatenate([np.zeros(0, np.int64), *parts])
    size = np.array([len(part) for part in parts], np.int64)
    first = np.cumsum(size) - size
    corners = triangles[order].astype(np.float64)
    low = np.minimum.reduceat(corners.min(axis=1), first) if parts else np.zeros((0, 3))
    high = np.maximum.reduceat(corners.max(axis=1), first) if parts else np.zeros((0, 3))
    return Clusters(order, first, size, large[order[first]], (low + high) / 2, (high - low) / 2 + _MARGIN)


def _halve(triangles: np.ndarray, chosen: np.ndarray, most: int) -> list[np.ndarray]:
    centroids = triangles.mean(axis=1)
    parts: list[np.ndarray] = []
    waiting = [chosen] if len(chosen) else []
    while waiting:
        part = waiting.pop()
        if len(part) <= most:
            parts.append(part)
            continue
        here = centroids[part]
        half = len(part) // 2
        split = np.argpartition(here[:, np.ptp(here, axis=0).argmax()], half)
        waiting += [part[split[half:]], part[split[:half]]]
    return parts


def likely_occluders(clusters: Clusters, numbers: np.ndarray) -> np.ndarray:
    """Select the clusters to draw first because they may occlude others: large triangles, and the nearest small ones.

    Args:
        clusters: the clusters.
        numbers: N int64, indices of the clusters in view, the nearest first.

    Returns:
        N bool, a mask of `numbers`.
    """
    small = np.where(clusters.large[numbers], 0, clusters.size[numbers])
    return np.asarray(clusters.large[numbers] | (np.cumsum(small) <= _NEAREST * small.sum()))


class Frustum:
    """The view frustum of a camera, unbounded in depth.

    Args:
        camera: the camera.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        f, x, y = camera.focal_length, camera.width / 2, camera.height / 2
        normals = np.array([[f, 0, x], [-f, 0, x], [0, f, y], [0, -f, y], [0, 0, 1.0]])
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)  # inwards, in camera axes

    def within(self, clusters: Clusters, pose: np.ndarray) -> np.ndarray:
        """Find the clusters whose bounding boxes intersect the frustum, the nearest first.

        Args:
            clusters: the clusters.
            pose: 4 x 4 camera-to-world.

        Returns:
            Their indices, int64.
        """
        normals = self._normals @ pose[:3, :3].T
        return _within(clusters.center, clusters.extent, normals, np.ascontiguousarray(pose[:3, 3]))

    def not_hidden(self, clusters: Clusters, numbers: np.ndarray, pose: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Drop the clusters whose bounding boxes are behind the depth drawn so far (Greene et al., SIGGRAPH 1993).

        Args:
            clusters: the clusters.
            numbers: indices of clusters that have not been drawn yet.
            pose: 4 x 4 camera-to-world.
            depth: H x W float32 metres, the depth drawn so far, 0 = none.

        Returns:
            The indices of clusters that may be visible, in the same order.
        """
        camera_from_world = np.linalg.inv(pose)
        camera = self._camera
        lens = np.array([camera.focal_length, camera.width / 2, camera.height / 2])
        hidden = _hidden(clusters.center, clusters.extent, numbers, camera_from_world, lens, _farthest(depth))
        return numbers[~hidden]


@compiled(nogil=True)
def _within(center: np.ndarray, extent: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Indices of the boxes that reach to the inner side of all planes through `eye`, sorted by their distance to it."""
    indices = np.empty(len(center), np.int64)
    distance = np.empty(len(center), np.float64)
    count = 0
    for i in range(len(center)):
        inside = True
        for plane in range(len(normals)):
            reach = 0.0
            for axis in range(3):
                normal = normals[plane, axis]
                reach += normal * (center[i, axis] - eye[axis]) + abs(normal) * extent[i, axis]
            if reach < 0.0:
                inside = False
                break
        if inside:
            squared = 0.0
            for axis in range(3):
                squared += max(0.0, abs(center[i, axis] - eye[axis]) - extent[i, axis]) ** 2
            indices[count], distance[count] = i, squared
            count += 1
    return indices[:count][np.argsort(distance[:count], kind="mergesort")]


@compiled(nogil=True)
def _farthest(depth: np.ndarray) -> np.ndarray:
    """The greatest depth in each tile of 8 x 8 pixels; infinite if any of its pixels has no depth."""
    rows, columns = (depth.shape[0] + _TILE - 1) // _TILE, (depth.shape[1] + _TILE - 1) // _TILE
    farthest = np.zeros((rows, columns), np.float32)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            here = depth[row, column]
            if here == 0.0:
                here = np.float32(np.inf)
            farthest[row // _TILE, column // _TILE] = max(farthest[row // _TILE, column // _TILE], here)
    return farthest


@compiled(nogil=True)
def _hidden(
    center: np.ndarray,
    extent: np.ndarray,
    numbers: np.ndarray,
    camera_from_world: np.ndarray,
    lens: np.ndarray,
    farthest: np.ndarray,
) -> np.ndarray:
    """Whether each box is behind the farthest depth of all tiles that its projection touches."""
    hidden = np.zeros(len(numbers), np.bool_)
    rows, columns = farthest.shape
    corner = np.empty(3)
    for i in range(len(numbers)):
        left, top, right, bottom, nearest = np.inf, np.inf, -np.inf, -np.inf, np.inf
        for sides in range(8):
            for axis in range(3):
                side = 1.0 if sides >> axis & 1 else -1.0
                corner[axis] = center[numbers[i], axis] + side * extent[numbers[i], axis]
            x, y, z = camera_from_world[:3, 3]
            for axis in range(3):
                x += camera_from_world[0, axis] * corner[axis]
                y += camera_from_world[1, axis] * corner[axis]
                z += camera_from_world[2, axis] * corner[axis]
            nearest = min(nearest, z)
            if z > 0.0:
                u, v = lens[0] * x / z + lens[1], lens[0] * y / z + lens[2]
                left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
        if nearest < 0.01:
            continue
        first_row, last_row = max(0, int(top - 1) // _TILE), min(rows - 1, int(bottom + 1) // _TILE)
        first_column, last_column = max(0, int(left - 1) // _TILE), min(columns - 1, int(right + 1) // _TILE)
        behind = True
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                if farthest[row, column] >= nearest:
                    behind = False
                    break
            if not behind:
                break
        hidden[i] = behind
    return hidden
