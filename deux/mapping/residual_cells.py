"""Pixels' residuals, accumulated in the cells of a floor plan."""

import math

import numpy as np

from deux.compilation import compiled
from deux.geometry.camera import Camera
from deux.mapping.growing_grid import GrowingGrid


class ResidualCells:
    """Sums and counts of the residuals in each cell, of points at any height, in classes by distance.

    Args:
        camera: the camera that the depth images come from.
        max_range: distance along the floor in metres up to which pixels count.
        resolution: edge of a cell in metres.
        distances: boundaries of the distance classes in metres along the floor, increasing.
        layers: further arrays over the same cells, name -> dtype.
    """

    def __init__(
        self,
        camera: Camera,
        max_range: float,
        resolution: float,
        distances: tuple[float, ...] = (),
        layers: dict[str, type] | None = None,
    ) -> None:
        self._camera = camera
        self._max_range = max_range
        self._resolution = resolution
        self._distances = np.array(distances, np.float64)
        self._classes = range(len(distances) + 1)
        sums: dict[str, type] = {f"total {number}": np.float64 for number in self._classes}
        counts: dict[str, type] = {f"count {number}": np.int64 for number in self._classes}
        self.grid = GrowingGrid(resolution, sums | counts | (layers or {}))

    @property
    def totals(self) -> tuple[np.ndarray, ...]:
        """Sum of each cell's residuals, rows x columns float64, for each distance class, nearest first."""
        return tuple(self.grid[f"total {number}"] for number in self._classes)

    @property
    def counts(self) -> tuple[np.ndarray, ...]:
        """Number of each cell's residuals, rows x columns int64, for each distance class."""
        return tuple(self.grid[f"count {number}"] for number in self._classes)

    def add(self, pose: np.ndarray, depth: np.ndarray, residual: np.ndarray) -> None:
        """Add one frame's residuals.

        Args:
            pose: 4 x 4 camera-to-world.
            depth: H x W metres, 0 or NaN = none.
            residual: H x W, NaN = none.
        """
        self.grid.cover(float(pose[0, 3]), float(pose[2, 3]), self._max_range + self._resolution)
        frame, k = self.grid.frame, self._camera.intrinsics
        _add(
            np.asarray(depth, np.float32),
            np.asarray(residual, np.float32),
            np.ascontiguousarray(pose, np.float64),
            (k[0, 0], k[0, 2], k[1, 2]),
            self._max_range,
            self._distances,
            (frame.origin_x, frame.origin_z, self._resolution),
            self.totals,
            self.counts,
        )


@compiled
def _add(depth, residual, pose, lens, max_range, distances, lattice, totals, counts):  # type: ignore[no-untyped-def]
    """Add each pixel's residual to the cell that its point falls into, in the class of its distance."""
    f, cx, cy = lens
    origin_x, origin_z, resolution = lattice
    for v in range(depth.shape[0]):
        b = (v - cy) / f
        for u in range(depth.shape[1]):
            d = depth[v, u]
            if not d > 0.0 or not np.isfinite(residual[v, u]):
                continue
            a = (u - cx) / f
            dx = (pose[0, 0] * a + pose[0, 1] * b + pose[0, 2]) * d
            dz = (pose[2, 0] * a + pose[2, 1] * b + pose[2, 2]) * d
            distance = math.sqrt(dx * dx + dz * dz)
            if distance > max_range:
                continue
            at_distance = 0
            for bound in distances:
                if distance >= bound:
                    at_distance += 1
            row = int((pose[2, 3] + dz - origin_z) / resolution)
            column = int((pose[0, 3] + dx - origin_x) / resolution)
            totals[at_distance][row, column] += residual[v, u]
            counts[at_distance][row, column] += 1
