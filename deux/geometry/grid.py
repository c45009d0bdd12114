"""Top-down grids over the floor: rows run along the world's z, columns along its x."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class GridFrame:
    """Position, size and resolution of a top-down grid.

    Cell (row, column) covers x in [origin_x + column * resolution, ... + resolution), and z likewise by row.

    Args:
        origin_x: world x of the outer edge of column 0, metres.
        origin_z: world z of the outer edge of row 0, metres.
        rows: number of cells along z.
        columns: number of cells along x.
        resolution: edge of a cell in metres.
    """

    origin_x: float
    origin_z: float
    rows: int
    columns: int
    resolution: float = 0.05

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns), the shape of an array over this grid."""
        return self.rows, self.columns

    def cells(self, x: np.ndarray | float, z: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Row and column (int64 arrays) of world points, which may be outside of the grid, see `contains`."""
        rows = np.floor((np.asarray(z) - self.origin_z) / self.resolution).astype(np.int64)
        columns = np.floor((np.asarray(x) - self.origin_x) / self.resolution).astype(np.int64)
        return rows, columns

    def cell(self, x: float, z: float) -> tuple[int, int]:
        """Row and column of one world point, clamped to the grid."""
        # Plain numbers: this is called many times per step, and arrays of one element are ten times slower.
        row, column = (z - self.origin_z) / self.resolution, (x - self.origin_x) / self.resolution
        return int(min(max(0.0, row), self.rows - 1)), int(min(max(0.0, column), self.columns - 1))

    def contains(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Whether each (row, column) pair is inside the grid, as a boolean array."""
        return (rows >= 0) & (rows < self.rows) & (columns >= 0) & (columns < self.columns)

    def centre(self, row: float, column: float) -> tuple[float, float]:
        """World (x, z) of a cell's centre."""
        x = self.origin_x + (column + 0.5) * self.resolution
        z = self.origin_z + (row + 0.5) * self.resolution
        return float(x), float(z)


@dataclass(frozen=True)
class FreeSpace:
    """Ground truth map of the positions that the robot's centre can take.

    Args:
        frame: position, size and resolution of the grid.
        free: rows x columns bool, true where the robot's centre can be (obstacles are dilated by its radius).
        clearance: rows x columns float32, distance from a cell's centre to the nearest obstacle (before dilation) in
            metres.
        floor_height: world y of the floor in metres; steps and ramps may be higher or lower.
        heights: rows x columns float32, world y of the surface at each free cell's centre in metres, NaN elsewhere;
            defaults to `floor_height` in all free cells.
    """

    frame: GridFrame
    free: np.ndarray
    clearance: np.ndarray
    floor_height: float
    heights: np.ndarray = None  # type: ignore[assignment]  # set below

    def __post_init__(self) -> None:
        if self.heights is None:
            level = np.where(self.free, np.float32(self.floor_height), np.float32(np.nan))
            object.__setattr__(self, "heights", level)

    def height_at(self, x: float, z: float) -> float:
        """World y of the surface at a point in metres; `floor_height` where the point is not free."""
        rows, columns = self.frame.cells(x, z)
        if self.frame.contains(rows, columns) and self.free[rows, columns]:
            return float(self.heights[rows, columns])
        return self.floor_height

    def moved(self, x: float, y: float, z: float) -> "FreeSpace":
        """The free space translated by (x, y, z) metres."""
        frame = replace(self.frame, origin_x=self.frame.origin_x + x, origin_z=self.frame.origin_z + z)
        heights = (self.heights.astype(np.float64) + y).astype(np.float32)
        return replace(self, frame=frame, floor_height=self.floor_height + y, heights=heights)

    @property
    def area(self) -> float:
        """Free area in square metres."""
        return float(self.free.sum()) * self.frame.resolution**2
