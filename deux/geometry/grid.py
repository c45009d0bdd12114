"""Top-down grids over the floor: rows run along the world's z, columns along its x."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class GridFrame:
    """Where a top-down grid lies in the world.

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
        """Row and column (int64 arrays) of world points; they may lie outside, see `contains`."""
        rows = np.floor((np.asarray(z) - self.origin_z) / self.resolution).astype(np.int64)
        columns = np.floor((np.asarray(x) - self.origin_x) / self.resolution).astype(np.int64)
        return rows, columns

    def cell(self, x: float, z: float) -> tuple[int, int]:
        """Row and column of one world point, moved to the border where it lies outside."""
        # Plain numbers: an explorer asks this many times a step, and arrays of one element take ten times as long.
        row, column = (z - self.origin_z) / self.resolution, (x - self.origin_x) / self.resolution
        return int(min(max(0.0, row), self.rows - 1)), int(min(max(0.0, column), self.columns - 1))

    def contains(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Which (row, column) pairs lie inside the grid, as a boolean array."""
        return (rows >= 0) & (rows < self.rows) & (columns >= 0) & (columns < self.columns)

    def centre(self, row: float, column: float) -> tuple[float, float]:
        """World (x, z) of a cell's centre."""
        x = self.origin_x + (column + 0.5) * self.resolution
        z = self.origin_z + (row + 0.5) * self.resolution
        return float(x), float(z)


@dataclass(frozen=True)
class FreeSpace:
    """The true free floor of a scene: where the centre of the robot can stand.

    Args:
        frame: position, size and resolution of the grid.
        free: rows x columns bool, true where the robot's centre may be (obstacles are already grown by its radius).
        clearance: rows x columns float32, metres from a cell's centre to the nearest obstacle (before growing).
        floor_height: world y of the floor in metres; the floor's steps and ramps may be higher or lower.
        heights: rows x columns float32, world y in metres of the surface at each free cell's centre, NaN elsewhere;
            `floor_height` in every free cell where it is not given.
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
        """World y in metres of the surface under a world point; the floor's own height where that is not free."""
        rows, columns = self.frame.cells(x, z)
        if self.frame.contains(rows, columns) and self.free[rows, columns]:
            return float(self.heights[rows, columns])
        return self.floor_height

    def moved(self, x: float, y: float, z: float) -> "FreeSpace":
        """The same free space as a world sees it whose origin lies at -(x, y, z), metres."""
        frame = replace(self.frame, origin_x=self.frame.origin_x + x, origin_z=self.frame.origin_z + z)
        heights = (self.heights.astype(np.float64) + y).astype(np.float32)
        return replace(self, frame=frame, floor_height=self.floor_height + y, heights=heights)

    @property
    def area(self) -> float:
        """Free area in square metres."""
        return float(self.free.sum()) * self.frame.resolution**2
