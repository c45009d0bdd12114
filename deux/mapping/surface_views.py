"""What is known of the surfaces: how uncertain the depth model is of them, by distance, and how they were seen."""

import math

import numpy as np

from deux.geometry.camera import Camera
from deux.mapping.residual_cells import ResidualCells
from deux.mapping.view_fan import NOTHING, SURFACE, Rays, headings

DISTANCES = (1.0, 3.0)
"""Metres at which the distance classes end: near, middle, and far beyond."""

SECTORS = 16
"""Bearings from which a surface is seen alike: 22.5 degrees each, about a metre of parallax at 2.5 m."""


class SurfaceViews:
    """The uncertainty of surfaces and the ways in which they were seen, on cells of the floor plan.

    A cell keeps, for each class of distances from which it was seen, the mean residual of the pixels that showed it
    at any height; and a set of views: which of the SECTORS x 3 pairs of bearing and distance class it was seen in.

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
            residual: H x W uncertainty of the pixels, not negative, NaN = not known.
        """
        self._residuals.add(pose, depth, residual)

    def mark_seen(self, rays: Rays, shown: np.ndarray) -> None:
        """Remember that what the rays end in was seen, surfaces and what stays unknown alike.

        Args:
            rays: of one place or more.
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
        """The uncertainty of what each ray shows, N x R float64; 0 for `NOTHING`.

        A surface has the mean residual of its cell in the class of the ray's distance; where it was never seen from
        that distance, the mean over the other classes; where it has none, and for the unknown, the mean over all
        surfaces, in that class if there are any. 1 where no residual is known at all.
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
        """The views in which the end of each ray was seen, N x R int64: a bit for each pair of bearing and distance."""
        rows, columns = self._inside(rays)
        views = self._residuals.grid["views"]
        return np.where(rows >= 0, views[rows, columns], 0) if views.size else np.zeros(rays.kind.shape, np.int64)

    def _inside(self, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of each ray's end; -1 where it has none or lies outside the grid."""
        ends = np.where(np.isfinite(rays.ends), rays.ends, 0.0)
        frame = self._residuals.grid.frame
        rows, columns = frame.cells(ends[..., 0], ends[..., 1])
        inside = frame.contains(rows, columns) & (rays.kind != NOTHING)
        return np.where(inside, rows, -1), np.where(inside, columns, -1)


def views_of(rays: Rays) -> np.ndarray:
    """The view in which each ray shows its end, one bit of an int64."""
    sector = (headings(rays.kind.shape[1]) / (2.0 * math.pi) * SECTORS).astype(np.int64)
    return np.int64(1) << (sector * (len(DISTANCES) + 1) + np.digitize(rays.distance, DISTANCES))
