"""Triangulation of convex and concave polygons."""

import mapbox_earcut
import numpy as np


@np.errstate(all="ignore")  # warnings for infinite vertices, for which the mesh reader raises an error
def triangulate(points: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate polygons: convex ones as fans, others by ear clipping in their plane.

    Polygons that are not planar are projected along their Newell normal, the area-weighted mean normal. Polygons with
    fewer than three corners have no triangles.

    Args:
        points: N x 3, the corners of all polygons, concatenated.
        lengths: P ints, the number of corners of each polygon; their sum is N.

    Returns:
        T x 3 int64, the corners of each triangle as indices into `points`, and T int64, the polygon of each triangle,
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
    """The Newell normals of P x n x 3 polygons (P x 3, of twice the area in length), and which polygons are convex."""
    polygons = polygons - polygons[:, :1]
    following = np.roll(polygons, -1, axis=1)
    normals = np.cross(polygons, following).sum(axis=1)
    edges = following - polygons
    turns = np.einsum("pnc,pc->pn", np.cross(edges, np.roll(edges, -1, axis=1)), normals)
    return normals, (turns >= -1e-9 * (normals**2).sum(axis=1, keepdims=True)).all(axis=1)


def _ears(polygon: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Triangulate one n x 3 polygon projected along its normal; T x 3 indices."""
    dropped = int(np.abs(normal).argmax())  # project along the axis nearest to the normal
    flat = np.ascontiguousarray(np.delete(polygon - polygon[0], dropped, axis=1), dtype=np.float64)
    triangles = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32))
    return np.asarray(triangles, np.int64).reshape(-1, 3)
