"""Observed surfaces: the depth model's uncertainty by viewing distance, and the views in which they were seen."""

import math

import numpy as np

from deux.geometry.camera import Camera
from deux.mapping.residual_cells import ResidualCells
from deux.mapping.view_fan import NOTHING, SURFACE, Rays, headings

DISTANCES = (1.0, 3.0)
"""Boundaries of the distance classes in metres: near, middle and far."""

SECTORS = 16
"""Number of bearing classes: 22.5 degrees each, about a metre of parallax at 2.5 m."""


class SurfaceViews:
    """The uncertainty of surfaces, and the views in which they were seen, in the cells of a floor plan.

    A cell stores, for each distance class, the mean residual of the pixels that showed it, at any height; and the set
    of views in which it was seen, where a view is one of SECTORS x 3 pairs of bearing and distance class.

    Args:
        camera: the camera that the depth images come from.
        max_range: distance along the floor in metres up to which pixels count.
        resolution: edge of a cell in metres.
    """

    def __init__(self, camera: Camera, max_range: float = 5.0, resolution: float = 0.1) -> None:
        self._residuals = ResidualCells(camera, max_range, resolution, DISTANCES, {"views": np.int64})

    def record(self, pose: np.ndarray, depth: np.ndarray, residual: np.ndarray) -> None:
        """Add one frame's residuals.

        Args:
            pose: 4 x 4 camera-to-world.
            depth: H x W metres, 0 or NaN = none.
            residual: H x W uncertainty of the pixels, not negative, NaN = none.
        """
        self._residuals.add(pose, depth, residual)

    def mark_seen(self, rays: Rays, shown: np.ndarray) -> None:
        """Record that the end points of rays, surfaces and unknown cells, were seen.

        Args:
            rays: rays from one or more places.
            shown: N x R bool, the rays inside the field of view.
        """
        shown = shown & (rays.kind != NOTHING)
        if not shown.any():
            return
        ends = rays.ends[shown]
        least, most = ends.min(axis=0), ends.max(axis=0)
        x, z = (least + most) / 2.0
        cells = self._residuals.grid
        cells.cover(float(x), float(z), float((most - least).max()) / 2.0 + cells.frame.resolution)
        rows, columns = cells.frame.cells(ends[:, 0], ends[:, 1])
        np.bitwise_or.at(cells["views"], (rows, columns), views_of(rays)[shown])

    def uncertainty(self, rays: Rays) -> np.ndarray:
        """The uncertainty of each ray's end point, N x R float64; 0 for `NOTHING`.

        For a surface, it is the mean residual of its cell in the ray's distance class or, if it was never seen from
        that distance, over all classes. For surfaces without residuals and unknown cells, it is the mean over all
        surfaces, in the ray's distance class if there are any. It is 1 if there are no residuals at all.
        """
        total, count = np.stack(self._residuals.totals), np.stack(self._residuals.counts)
        if count.sum() == 0:
            return (rays.kind != NOTHING).astype(np.float64)
        totals, counts = total.sum(axis=(1, 2)), count.sum(axis=(1, 2))
        means = np.where(counts > 0, totals / np.maximum(counts, 1), totals.sum() / counts.sum())
        at_distance = np.digitize(rays.distance, DISTANCES)
        value = np.where(rays.kind == NOTHING, 0.0, means[at_distance])
        rows, columns = self._inside(rays)
        known = (rays.kind == SURFACE) & (rows >= 0)
        chosen = at_distance[known], rows[known], columns[known]
        own_total, own_count = total[chosen], count[chosen]
        all_total, all_count = (layer.sum(axis=0)[chosen[1:]] for layer in (total, count))
        result = np.where(own_count > 0, own_total / np.maximum(own_count, 1), all_total / np.maximum(all_count, 1))
        value[known] = np.where(all_count > 0, result, value[known])
        return value

    def seen_in(self, rays: Rays) -> np.ndarray:
        """The views in which each ray's end point was seen, N x R int64, a bit for each bearing and distance class."""
        rows, columns = self._inside(rays)
        views = self._residuals.grid["views"]
        return np.where(rows >= 0, views[rows, columns], 0) if views.size else np.zeros(rays.kind.shape, np.int64)

    def _inside(self, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of each ray's end point; -1 if there is none or it is outside the grid."""
        ends = np.where(np.isfinite(rays.ends), rays.ends, 0.0)
        frame = self._residuals.grid.frame
        rows, columns = frame.cells(ends[..., 0], ends[..., 1])
        inside = frame.contains(rows, columns) & (rays.kind != NOTHING)
        return np.where(inside, rows, -1), np.where(inside, columns, -1)


def views_of(rays: Rays) -> np.ndarray:
    """The view in which each ray shows its end point, as one bit of an int64."""
    sector = (headings(rays.kind.shape[1]) / (2.0 * math.pi) * SECTORS).astype(np.int64)
    return np.int64(1) << (sector * (len(DISTANCES) + 1) + np.digitize(rays.distance, DISTANCES))
