"""The scaffolding of a depth map: the linear interpolation of its sparse points."""

from functools import cache
from typing import Literal

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import distance_transform_edt
from scipy.spatial import Delaunay, QhullError
from threadpoolctl import ThreadpoolController


def interpolate(sparse_depth: np.ndarray, outside: Literal["nearest", "zero"] = "nearest") -> np.ndarray:
    """Densify sparse depth by linear interpolation over a Delaunay triangulation of its points.

    It is VOICED's input, and what every trained model is compared with.

    Args:
        sparse_depth: H x W metres, 0 = none.
        outside: what pixels outside the points' convex hull get: the nearest point's depth, or 0.

    Returns:
        H x W float32 metres. Where no triangle can be made (fewer than three points, or all on one line) every pixel
        takes the nearest point's depth, whatever `outside` says; without any point the result is 0 everywhere.

    Example:
        >>> interpolate(np.array([[1.0, 0.0, 3.0], [0.0, 0.0, 0.0], [1.0, 0.0, 3.0]]))[1].tolist()
        [1.0, 2.0, 3.0]
    """
    rows, columns = np.nonzero(sparse_depth)
    if rows.size == 0:
        return np.zeros(sparse_depth.shape, np.float32)
    depths = sparse_depth[rows, columns].astype(np.float64)
    try:
        # A triangle is a linear system of two unknowns, which BLAS would hand to threads that wait for each other: on a
        # machine with other work, 2 ms become a second.
        with _blas().limit(limits=1, user_api="blas"):
            triangulation = Delaunay(np.stack([rows, columns], axis=1).astype(np.float64))
            dense = LinearNDInterpolator(triangulation, depths)(*np.indices(sparse_depth.shape))
    except (QhullError, ValueError):  # fewer than three points, or all of them on one line
        return _nearest(sparse_depth)
    beyond = np.isnan(dense)
    if not beyond.any():
        return dense.astype(np.float32)
    return np.where(beyond, _nearest(sparse_depth) if outside == "nearest" else 0.0, dense).astype(np.float32)


@cache
def _blas() -> ThreadpoolController:
    """The process's BLAS libraries, looked up once, when scipy has loaded its own."""
    return ThreadpoolController()


def _nearest(sparse_depth: np.ndarray) -> np.ndarray:
    rows, columns = distance_transform_edt(sparse_depth == 0, return_distances=False, return_indices=True)
    return sparse_depth[rows, columns].astype(np.float32)
