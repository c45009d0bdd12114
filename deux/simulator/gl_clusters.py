"""Clusters of neighbouring triangles, and which of them a camera may see."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from deux.compilation import compiled
from deux.contracts import SceneMesh
from deux.geometry.camera import Camera

_MARGIN = 1e-3  # metres by which boxes are taken to be larger, more than rounding in float32 moves a corner


class Clusters(NamedTuple):
    """Triangles sorted such that neighbours in space follow each other, in C clusters.

    Args:
        order: F int64, the mesh's face at each place of the sorted order.
        first: C int64, the place at which each cluster begins.
        count: C int64, number of its triangles.
        center: C x 3 float64, centre of its bounding box in metres.
        extent: C x 3 float64, half the size of the box.
    """

    order: np.ndarray
    first: np.ndarray
    count: np.ndarray
    center: np.ndarray
    extent: np.ndarray


def make_clusters(mesh: SceneMesh, most: int = 64) -> Clusters:
    """Halve the mesh at the median of its longest axis until no part has more than `most` triangles (a k-d tree)."""
    triangles = mesh.triangles
    centroids = triangles.mean(axis=1)
    parts: list[np.ndarray] = []
    waiting = [np.arange(len(triangles))] if len(triangles) else []
    while waiting:
        part = waiting.pop()
        if len(part) <= most:
            parts.append(part)
            continue
        here = centroids[part]
        half = len(part) // 2
        split = np.argpartition(here[:, np.ptp(here, axis=0).argmax()], half)
        waiting += [part[split[half:]], part[split[:half]]]
    order = np.concatenate(parts) if parts else np.zeros(0, np.int64)
    count = np.array([len(part) for part in parts], np.int64)
    first = np.cumsum(count) - count
    corners = triangles[order].astype(np.float64)
    low = np.minimum.reduceat(corners.min(axis=1), first) if parts else np.zeros((0, 3))
    high = np.maximum.reduceat(corners.max(axis=1), first) if parts else np.zeros((0, 3))
    return Clusters(order, first, count, (low + high) / 2, (high - low) / 2 + _MARGIN)


class Frustum:
    """The part of space that a camera sees, without bounds in depth.

    Args:
        camera: the camera.
    """

    def __init__(self, camera: Camera) -> None:
        f, x, y = camera.focal_length, camera.width / 2, camera.height / 2
        normals = np.array([[f, 0, x], [-f, 0, x], [0, f, y], [0, -f, y], [0, 0, 1.0]])
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)  # inwards, in camera axes

    def clusters(self, clusters: Clusters, pose: np.ndarray) -> np.ndarray:
        """Find the clusters whose boxes reach into the frustum, the nearest first.

        Args:
            clusters: the triangles.
            pose: 4 x 4 camera-to-world.

        Returns:
            Their numbers, int64.
        """
        normals = self._normals @ pose[:3, :3].T
        return _seen(clusters.center, clusters.extent, normals, np.ascontiguousarray(pose[:3, 3]))


@compiled(nogil=True)
def _seen(center: np.ndarray, extent: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Boxes on the inner side of all planes through `eye`, by their distance to it."""
    found = np.empty(len(center), np.int64)
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
            found[count], distance[count] = i, squared
            count += 1
    return found[:count][np.argsort(distance[:count], kind="mergesort")]
