"""Triangulation of the polygons of mesh files, concave ones included."""

import mapbox_earcut
import numpy as np


@np.errstate(all="ignore")  # of vertices at infinity, which the mesh's reader refuses
def triangulate(points: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons into triangles: convex ones into a fan, all others by ear clipping in the plane they lie in.

    A polygon whose corners are not in one plane is looked at along its Newell normal, the mean of its corners'
    normals weighted by area. Polygons of fewer than three corners have no triangles.

    Args:
        points: N x 3, the corners of the first polygon in order, then those of the second, and so on.
        lengths: P ints, the number of corners of each polygon; their sum is N.

    Returns:
        T x 3 int64, the corners of each triangle as indices into `points`, and T int64, the polygon it belongs to;
        in the order of the polygons.
    """
    starts = np.cumsum(lengths) - lengths
    corners, owners = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    for length in np.unique(lengths[lengths >= 3]):
        same = np.flatnonzero(lengths == length)
        index = starts[same, None] + np.arange(length)
        convex = np.ones(len(same), bool)
        if length > 3:
            normals, convex = _newell(points[index])
            for number in np.flatnonzero(~convex):
                cut = index[number][_ears(points[index[number]], normals[number])]
                corners.append(cut)
                owners.append(np.full(len(cut), same[number]))
        fan = np.stack([np.zeros(length - 2, np.int64), np.arange(1, length - 1), np.arange(2, length)], axis=1)
        corners.append(index[convex][:, fan].reshape(-1, 3))
        owners.append(np.repeat(same[convex], length - 2))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(corners).astype(np.int64)[order], owner[order]


def _newell(polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The Newell normal of P x n x 3 polygons (P x 3, as long as twice the area), and which of them are convex."""
    polygons = polygons - polygons[:, :1]
    following = np.roll(polygons, -1, axis=1)
    normals = np.cross(polygons, following).sum(axis=1)
    edges = following - polygons
    turns = np.einsum("pnc,pc->pn", np.cross(edges, np.roll(edges, -1, axis=1)), normals)
    return normals, (turns >= -1e-9 * (normals**2).sum(axis=1, keepdims=True)).all(axis=1)


def _ears(polygon: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Triangles of one n x 3 polygon seen along its normal, T x 3 indices."""
    dropped = int(np.abs(normal).argmax())  # the coordinate along which the polygon is seen most nearly face on
    flat = np.ascontiguousarray(np.delete(polygon - polygon[0], dropped, axis=1), dtype=np.float64)
    triangles = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32))
    return np.asarray(triangles, np.int64).reshape(-1, 3)
