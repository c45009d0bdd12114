"""Residual fields: the depth model's uncertainty over the floor, for two readings of the paper's residual pose."""

import math
from typing import Protocol

import cv2
import numpy as np

from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.mapping.residual_cells import ResidualCells


class ResidualField(Protocol):
    """Uncertainty over the floor, accumulated frame by frame."""

    def update(self, pose: np.ndarray, depth: np.ndarray, residual: np.ndarray, uncertainty: float) -> None:
        """Add one frame.

        Args:
            pose: 4 x 4 camera-to-world.
            depth: H x W metres, 0 or NaN = none.
            residual: H x W uncertainty of the pixels, not negative, NaN = none.
            uncertainty: delta of Eq. 8 in [0, 1], NaN = none.
        """

    def at(self, points: np.ndarray) -> np.ndarray:
        """Uncertainty near N x 2 world points (x, z): N float64 in [0, 1], always finite.

        Far from all records, it tends to their mean; without any record, it is 0.
        """

    def grid(self, frame: GridFrame) -> np.ndarray:
        """The field over a grid, rows x columns float32, NaN where nothing is recorded nearby."""


class PoseResidualField:
    """Records delta at the robot's pose; the uncertainty at a point is the weighted mean over nearby poses.

    The weight of a pose at distance d is exp(-d^2 / (2 bandwidth^2)). The mean of all deltas has the weight
    `prior_weight`, so that it dominates far from all poses.

    A bandwidth of two steps distinguishes places a metre apart. The prior is weak because targets are metres ahead of
    the poses, and should get the uncertainty found in their direction rather than the overall mean.

    Args:
        bandwidth: metres.
        prior_weight: weight of the mean, relative to a pose at distance 0.
    """

    _negligible = 9.0
    """Distance, in bandwidths, at which a weight is below the sum's rounding error."""

    def __init__(self, bandwidth: float = 0.5, prior_weight: float = 0.01) -> None:
        self._bandwidth = bandwidth
        self._prior_weight = prior_weight
        self._records: list[tuple[float, float, float]] = []

    def update(self, pose: np.ndarray, depth: np.ndarray, residual: np.ndarray, uncertainty: float) -> None:
        """Record the frame's delta at the pose, unless it is NaN."""
        if np.isfinite(uncertainty):
            self._records.append((float(pose[0, 3]), float(pose[2, 3]), float(uncertainty)))

    def at(self, points: np.ndarray) -> np.ndarray:
        """Uncertainty near N x 2 world points (x, z)."""
        if not self._records:
            return np.zeros(len(points))
        records = np.array(self._records)
        values, _ = self._average(points, records, records[:, 2].mean())
        return values

    def grid(self, frame: GridFrame) -> np.ndarray:
        """The field over a grid; NaN where the sum of weights is less than that of one pose two bandwidths away."""
        result = np.full(frame.shape, np.nan, np.float32)
        if not self._records:
            return result
        records = np.array(self._records)
        mean = records[:, 2].mean()
        x = frame.origin_x + (np.arange(frame.columns) + 0.5) * frame.resolution
        z = frame.origin_z + (np.arange(frame.rows) + 0.5) * frame.resolution
        for row in range(frame.rows):  # cells x poses at once would be gigabytes
            near = records[np.abs(records[:, 1] - z[row]) < self._negligible * self._bandwidth]
            values, weight = self._average(np.column_stack([x, np.full(len(x), z[row])]), near, mean)
            result[row] = np.where(weight > np.exp(-2.0), values, np.nan)
        return result

    def _average(self, points: np.ndarray, records: np.ndarray, mean: float) -> tuple[np.ndarray, np.ndarray]:
        """Weighted average of records at each point, and the sum of their weights."""
        # |a - b|^2 expanded: a product of matrices is many times faster than all differences on a whole grid.
        squares = (points**2).sum(1)[:, None] + (records[:, :2] ** 2).sum(1) - 2.0 * points @ records[:, :2].T
        weights = np.exp(-0.5 * squares / self._bandwidth**2)
        total = weights.sum(axis=1)
        values = (weights @ records[:, 2] + self._prior_weight * mean) / (total + self._prior_weight)
        return values, total


class SurfaceResidualField:
    """Records each pixel's residual at the surface point that the pixel shows, projected onto the floor.

    The uncertainty of a cell is 1 - exp(-mean), as in Eq. 8, of the mean residual of its points at any height. The
    uncertainty at a point is the average of nearby cells with weights exp(-d^2 / (2 bandwidth^2)). The mean of all
    cells has the weight `prior_weight`, so that it dominates far from all observed surfaces.

    Args:
        camera: the camera that the depth images come from.
        resolution: edge of a cell in metres.
        max_range: distance along the floor in metres up to which pixels are projected.
        bandwidth: metres.
        prior_weight: weight of the mean, relative to a cell at distance 0.
    """

    def __init__(
        self,
        camera: Camera,
        resolution: float = 0.05,
        max_range: float = 5.0,
        bandwidth: float = 0.5,
        prior_weight: float = 1.0,
    ) -> None:
        self._resolution = resolution
        self._bandwidth = bandwidth
        self._prior_weight = prior_weight
        self._residuals = ResidualCells(camera, max_range, resolution)

    def update(self, pose: np.ndarray, depth: np.ndarray, residual: np.ndarray, uncertainty: float) -> None:
        """Project the residuals of all pixels with depth onto the floor; NaN residuals are ignored."""
        self._residuals.add(pose, depth, residual)

    def at(self, points: np.ndarray) -> np.ndarray:
        """Uncertainty near N x 2 world points (x, z)."""
        uncertainty, seen = self._uncertainty()
        if not seen.any():
            return np.zeros(len(points))
        mean = uncertainty[seen].mean()
        own = self._residuals.grid.frame
        rows, columns = own.cells(points[:, 0], points[:, 1])
        inside = own.contains(rows, columns)
        values = np.full(len(points), mean)
        if not inside.any():
            return values
        rows, columns = rows[inside], columns[inside]
        sigma = self._bandwidth / self._resolution
        reach = math.ceil(4.0 * sigma)  # radius of GaussianBlur's kernel
        top, left = max(0, rows.min() - reach), max(0, columns.min() - reach)
        window = np.s_[top : rows.max() + reach + 1, left : columns.max() + reach + 1]

        def weighted_sum(cells: np.ndarray) -> np.ndarray:
            # GaussianBlur's kernel sums to 1; rescaled, a cell at distance 0 has weight 1.
            blurred = cv2.GaussianBlur(cells.astype(np.float32), (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
            return 2.0 * np.pi * sigma**2 * blurred[rows - top, columns - left]

        weight = weighted_sum(seen[window])
        total = weighted_sum(np.where(seen[window], uncertainty[window], 0.0))
        values[inside] = (total + self._prior_weight * mean) / (weight + self._prior_weight)
        return values

    def grid(self, frame: GridFrame) -> np.ndarray:
        """The cells' own means over a grid of the same resolution."""
        uncertainty, seen = self._uncertainty()
        if not seen.any():
            return np.full(frame.shape, np.nan, np.float32)
        rows, columns = np.mgrid[: frame.rows, : frame.columns]
        centres_x = frame.origin_x + (columns + 0.5) * frame.resolution
        centres_z = frame.origin_z + (rows + 0.5) * frame.resolution
        own = self._residuals.grid.frame
        own_rows, own_columns = own.cells(centres_x, centres_z)
        inside = own.contains(own_rows, own_columns)
        result = np.full(frame.shape, np.nan, np.float32)
        field = np.where(seen, uncertainty, np.nan)
        result[inside] = field[own_rows[inside], own_columns[inside]]
        return result

    def _uncertainty(self) -> tuple[np.ndarray, np.ndarray]:
        """1 - exp(-mean residual) of each cell, and which cells have one."""
        (total,), (count,) = self._residuals.totals, self._residuals.counts
        return 1.0 - np.exp(-total / np.maximum(count, 1)), count > 0
