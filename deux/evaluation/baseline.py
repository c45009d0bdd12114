"""What plain interpolation of the sparse points achieves: the number to read a trained model's beside."""

from typing import Literal

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import distance_transform_edt
from scipy.spatial import Delaunay, QhullError


def interpolate(sparse_depth: np.ndarray, outside: Literal["nearest", "zero"] = "nearest") -> np.ndarray:
    """Densify sparse depth by linear interpolation over a Delaunay triangulation of its points.

    Args:
        sparse_depth: H x W metres, 0 = none.
        outside: what pixels outside the points' convex hull get: the nearest point's depth or 0.

    Returns:
        H x W float32 metres. Where no triangle can be made (fewer than three points, or all on one line)
        every pixel takes the nearest point's depth; without any point the result is 0 everywhere.
    """
    rows, columns = np.nonzero(sparse_depth)
    if rows.size == 0:
        return np.zeros(sparse_depth.shape, np.float32)
    nearest = _nearest(sparse_depth)
    points = np.stack([rows, columns], axis=1).astype(np.float64)
    try:
        triangulation = Delaunay(points)
    except (QhullError, ValueError):  # fewer than three points, or all of them on one line
        return nearest
    interpolator = LinearNDInterpolator(triangulation, sparse_depth[rows, columns].astype(np.float64))
    grid_rows, grid_columns = np.indices(sparse_depth.shape)
    dense = interpolator(grid_rows, grid_columns)
    fill = nearest if outside == "nearest" else 0.0
    return np.where(np.isnan(dense), fill, dense).astype(np.float32)


def constant(sparse_depth: np.ndarray) -> np.ndarray:
    """Predict the median of the sparse points everywhere, H x W float32; 0 everywhere without any point."""
    valid = sparse_depth[sparse_depth > 0]
    return np.full(sparse_depth.shape, np.median(valid) if valid.size else 0.0, np.float32)


def _nearest(sparse_depth: np.ndarray) -> np.ndarray:
    rows, columns = distance_transform_edt(sparse_depth == 0, return_distances=False, return_indices=True)
    return sparse_depth[rows, columns].astype(np.float32)
