"""Habitat-Sim's navmesh on a grid: where the robot's centre can be, and how high the mesh is there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from deux.geometry.grid import GridFrame

EDGE = 1e-6  # of a triangle's height: a cell's centre on an edge belongs to the triangles on both sides


@dataclass(frozen=True)
class NavmeshSamples:
    """The navmesh at the centres of the cells of a grid; one cell may have several, on different storeys.

    Args:
        frame: position, size and resolution of the grid.
        rows: N int64.
        columns: N int64.
        heights: N float64: world y of the navmesh, metres.
        islands: N int64: the connected component of the navmesh.
    """

    frame: GridFrame
    rows: np.ndarray
    columns: np.ndarray
    heights: np.ndarray
    islands: np.ndarray

    def selected(self, chosen: np.ndarray) -> NavmeshSamples:
        """Those samples that N bool select."""
        return NavmeshSamples(
            self.frame, self.rows[chosen], self.columns[chosen], self.heights[chosen], self.islands[chosen]
        )

    def grid(self) -> np.ndarray:
        """Rows x columns float64: the height at each cell, the lowest one where there are several, NaN elsewhere."""
        heights = np.full(self.frame.shape, np.inf)
        np.minimum.at(heights, (self.rows, self.columns), self.heights)
        return np.where(np.isfinite(heights), heights, np.nan)


def sample_navmesh(pathfinder: Any, resolution: float = GridFrame.resolution) -> NavmeshSamples:
    """Sample every triangle of a navmesh at the centres of the cells within it.

    Habitat-Sim's own `get_topdown_view` samples the corners of cells, one storey at a time.

    Args:
        pathfinder: Habitat-Sim's, with a navmesh.
        resolution: edge of a cell in metres.
    """
    islands = [_triangles(pathfinder, island) for island in range(pathfinder.num_islands)]
    corners = np.concatenate([triangles.reshape(-1, 3) for triangles in islands])
    # One cell more on each side, so that a floor's border is inside the grid.
    low = corners.min(axis=0)[[0, 2]] - resolution
    columns, rows = np.ceil((corners.max(axis=0)[[0, 2]] + resolution - low) / resolution).astype(int)
    frame = GridFrame(float(low[0]), float(low[1]), int(rows), int(columns), resolution)
    found = [
        (*_sample_triangle(triangle, frame), island)
        for island, triangles in enumerate(islands)
        for triangle in triangles
    ]
    sizes = [len(heights) for _, _, heights, _ in found]
    samples = NavmeshSamples(
        frame,
        np.concatenate([rows for rows, _, _, _ in found]),
        np.concatenate([columns for _, columns, _, _ in found]),
        np.concatenate([heights for _, _, heights, _ in found]),
        np.repeat([island for _, _, _, island in found], sizes),
    )
    # A centre on the edge of two triangles of an island is one sample.
    keys = np.stack([samples.rows, samples.columns, samples.islands, np.round(samples.heights * 1e3).astype(np.int64)])
    return samples.selected(np.unique(keys, axis=1, return_index=True)[1])


def clearance(on_navmesh: np.ndarray, resolution: float, radius: float) -> np.ndarray:
    """The distance from each cell's centre to the nearest obstacle, rows x columns float32 in metres.

    A navmesh ends at the robot's radius from what is in the way; the border is taken half a cell from the last centre.

    Args:
        on_navmesh: rows x columns bool.
        resolution: edge of a cell in metres.
        radius: of the robot that the navmesh was made for, metres.
    """
    inside = np.pad(on_navmesh, 1)
    away = ndimage.distance_transform_edt(inside) - ndimage.distance_transform_edt(~inside)
    border = (away - 0.5 * np.sign(away)) * resolution
    return np.maximum(border + radius, 0.0)[1:-1, 1:-1].astype(np.float32)


def _triangles(pathfinder: Any, island: int) -> np.ndarray:
    """The triangles of an island, T x 3 x 3 float64."""
    # Vectors are magnum's in some versions and arrays in others.
    vertices = np.array([np.array(vertex) for vertex in pathfinder.build_navmesh_vertices(island)], np.float64)
    indices = np.array(pathfinder.build_navmesh_vertex_indices(island), np.int64)
    return vertices.reshape(-1, 3)[indices.reshape(-1, 3)]


def _sample_triangle(triangle: np.ndarray, frame: GridFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns and heights of the cells whose centres are in a triangle, seen from above."""
    empty = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangle
    area = (bx - ax) * (cz - az) - (cx - ax) * (bz - az)
    if area == 0.0:
        return empty
    first_row, first_column = frame.cells(triangle[:, 0].min(), triangle[:, 2].min())
    last_row, last_column = frame.cells(triangle[:, 0].max(), triangle[:, 2].max())
    rows, columns = np.mgrid[first_row : last_row + 1, first_column : last_column + 1]
    x = frame.origin_x + (columns + 0.5) * frame.resolution
    z = frame.origin_z + (rows + 0.5) * frame.resolution
    # Barycentric coordinates.
    b = ((x - ax) * (cz - az) - (cx - ax) * (z - az)) / area
    c = ((bx - ax) * (z - az) - (x - ax) * (bz - az)) / area
    inside = (b >= -EDGE) & (c >= -EDGE) & (b + c <= 1.0 + EDGE)
    return rows[inside], columns[inside], (ay + b * (by - ay) + c * (cy - ay))[inside]
