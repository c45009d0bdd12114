"""Scaffolding: linear interpolation of sparse depth points."""

from functools import cache
from typing import Literal

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import distance_transform_edt
from scipy.spatial import Delaunay, QhullError
from threadpoolctl import ThreadpoolController


def interpolate(sparse_depth: np.ndarray, outside: Literal["nearest", "zero"] = "nearest") -> np.ndarray:
    """Densify sparse depth by linear interpolation over a Delaunay triangulation of its points.

    It is the input of VOICED and the baseline of all evaluations.

    Args:
        sparse_depth: H x W metres, 0 = none.
        outside: depth outside of the points' convex hull: that of the nearest point, or 0.

    Returns:
        H x W float32 metres. Without a triangle (fewer than three points, or collinear points) every pixel has the
        depth of the nearest point, regardless of `outside`; without points all pixels are 0.

    Example:
        >>> interpolate(np.array([[1.0, 0.0, 3.0], [0.0, 0.0, 0.0], [1.0, 0.0, 3.0]]))[1].tolist()
        [1.0, 2.0, 3.0]
    """
    rows, columns = np.nonzero(sparse_depth)
    if rows.size == 0:
        return np.zeros(sparse_depth.shape, np.float32)
    depths = sparse_depth[rows, columns].astype(np.float64)
    try:
        # Each triangle is a linear system of two unknowns, for which BLAS would synchronise its threads: on a busy
        # machine this takes a second instead of 2 ms.
        with _blas().limit(limits=1, user_api="blas"):
            triangulation = Delaunay(np.stack([rows, columns], axis=1).astype(np.float64))
            dense = LinearNDInterpolator(triangulation, depths)(*np.indices(sparse_depth.shape))
    except (QhullError, ValueError):  # fewer than three points, or collinear points
        return _nearest(sparse_depth)
    beyond = np.isnan(dense)
    if not beyond.any():
        return dense.astype(np.float32)
    return np.where(beyond, _nearest(sparse_depth) if outside == "nearest" else 0.0, dense).astype(np.float32)


@cache
def _blas() -> ThreadpoolController:
    """Controller of the BLAS libraries, created once, after scipy has loaded its own."""
    return ThreadpoolController()


def _nearest(sparse_depth: np.ndarray) -> np.ndarray:
    rows, columns = distance_transform_edt(sparse_depth == 0, return_distances=False, return_indices=True)
    return sparse_depth[rows, columns].astype(np.float32)
