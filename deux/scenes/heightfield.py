"""Solid heightfield of a mesh as in Recast: the filled spans of each grid column, and where a robot can stand.

Reference: M. Mononen, Recast Navigation (solid heightfield, walkable spans, walkable climb).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from deux.compilation import compiled
from deux.geometry.grid import GridFrame

if TYPE_CHECKING:
    from deux.contracts import Robot, SceneMesh

SLOPE = math.cos(math.radians(45.0))
"""Least |cosine| between a walkable surface's normal and the vertical, as in Habitat-Sim's navigation mesh."""

TOUCH = 1e-4  # fraction of a cell; a triangle that overlaps a column by less only touches it
STEEP = 0.05  # |cosine| to the vertical below which a triangle's heights in a column are computed by clipping
TOLERANCE = 1e-4  # metres; for rounding errors when heights are compared with the robot's dimensions


@dataclass(frozen=True)
class WalkableSurface:
    """The surface in each column of a grid on which a robot can stand, the one nearest to a given height.

    Args:
        height: rows x columns float32, world y in metres, NaN if there is none.
        blocked: rows x columns bool, whether there is no surface or the robot cannot step onto it from a neighbour.
    """

    height: np.ndarray
    blocked: np.ndarray


class Spans(NamedTuple):
    """The filled spans of all columns, as linked lists from the lowest to the highest.

    Args:
        first: rows x columns int32, index of each column's lowest span, -1 if it is empty.
        following: S int32, index of the next higher span of the same column, -1 at the last.
        low: S float32, world y of the bottom.
        high: S float32, world y of the top.
        level: S float32, world y of the highest walkable surface in the span, -inf if there is none.
    """

    first: np.ndarray
    following: np.ndarray
    low: np.ndarray
    high: np.ndarray
    level: np.ndarray


def walkable_surface(
    mesh: SceneMesh, frame: GridFrame, robot: Robot, near: float, low: float, high: float
) -> WalkableSurface:
    """Find where a robot can stand and step.

    All triangles, including vertical ones, are rasterised into the columns. Surfaces of a column with gaps of less than
    `robot.height` form one span. The robot can stand on its top if a surface at the top, or at most `robot.max_climb`
    below, has a slope of at most 45 degrees. The orientation of triangles, which is not reliable in files, is not used.
    The robot can step between neighbouring columns if their tops differ by at most `robot.max_climb` and there is room
    for its height.

    Args:
        mesh: the scene.
        frame: the grid of columns.
        robot: its height and greatest climb.
        near: world y in metres; of several tops in a column the nearest to it is used.
        low: world y of the lowest top to use.
        high: world y of the highest top to use.
    """
    grid = (frame.origin_x, frame.origin_z, frame.resolution)
    band, gap = (low - TOLERANCE, high + robot.height), robot.height - TOLERANCE
    capacity = 2 * frame.rows * frame.columns
    while True:
        spans = _empty_spans(frame.shape, capacity)
        if _rasterise(mesh.vertices, mesh.faces, grid, band, gap, spans):
            break
        capacity *= 2
    height, ceiling = _nearest_tops(spans, near, low, high, robot.max_climb + TOLERANCE)
    return WalkableSurface(height, _blocked(height, ceiling, robot.max_climb + TOLERANCE, robot.height - TOLERANCE))


def _empty_spans(shape: tuple[int, int], capacity: int) -> Spans:
    low, high, level = (np.empty(capacity, np.float32) for _ in range(3))
    return Spans(np.full(shape, -1, np.int32), np.empty(capacity, np.int32), low, high, level)


@compiled(nogil=True)
def _rasterise(
    vertices: np.ndarray,
    faces: np.ndarray,
    grid: tuple[float, float, float],
    band: tuple[float, float],
    gap: float,
    spans: Spans,
) -> bool:
    """Rasterise all triangles that reach into a band of heights.

    Args:
        vertices: V x 3.
        faces: F x 3.
        grid: x and z of the grid's outer corner, and the edge of a column.
        band: lower and upper height.
        gap: spans that are nearer to each other than this are merged.
        spans: empty columns; receives the result.

    Returns:
        Whether the capacity was sufficient for all spans.
    """
    rows, columns = spans.first.shape
    used = 0
    # Polygons in units of columns, (x, y, z) of up to 3 + 4 corners.
    polygon, strip, piece, other = np.empty((8, 3)), np.empty((8, 3)), np.empty((8, 3)), np.empty((8, 3))
    for face in faces:
        for corner in range(3):
            polygon[corner, 0] = (vertices[face[corner], 0] - grid[0]) / grid[2]
            polygon[corner, 1] = vertices[face[corner], 1]
            polygon[corner, 2] = (vertices[face[corner], 2] - grid[1]) / grid[2]
        bottom, top = _extent(polygon, 3, 1)
        if top < band[0] or bottom > band[1]:
            continue
        first_row, last_row = _touched(polygon, 3, 2, rows)
        first, last = _touched(polygon, 3, 0, columns)
        if first_row > last_row or first > last:
            continue
        slope_x, slope_z, flatness = _plane(polygon, grid[2])
        for row in range(first_row, last_row + 1):
            count = _between(polygon, 3, strip, other, 2, row)
            if count == 0:
                continue
            first, last = _touched(strip, count, 0, columns)
            lowest, highest = _extent(strip, count, 1)
            for column in range(first, last + 1):
                below, above = lowest, highest
                if flatness > STEEP:
                    middle = (
                        polygon[0, 1] + slope_x * (column + 0.5 - polygon[0, 0]) + slope_z * (row + 0.5 - polygon[0, 2])
                    )
                    spread = 0.5 * (abs(slope_x) + abs(slope_z))
                    below, above = max(below, middle - spread), min(above, middle + spread)
                elif last > first:
                    below, above = _extent(piece, _between(strip, count, piece, other, 0, column), 1)
                level = above if flatness >= SLOPE else -np.inf
                if used == len(spans.low):
                    return False
                used = _insert(spans, used, row, column, min(below, above), max(below, above), level, gap)
    return True


@compiled(nogil=True)
def _extent(polygon: np.ndarray, count: int, axis: int) -> tuple[float, float]:
    """Least and greatest coordinate of a polygon's corners along an axis."""
    least = greatest = polygon[0, axis]
    for corner in range(1, count):
        least, greatest = min(least, polygon[corner, axis]), max(greatest, polygon[corner, axis])
    return least, greatest


@compiled(nogil=True)
def _touched(polygon: np.ndarray, count: int, axis: int, cells: int) -> tuple[int, int]:
    """First and last cell along an axis that a polygon overlaps by more than `TOUCH`."""
    least, greatest = _extent(polygon, count, axis)
    if greatest - least > 2.0 * TOUCH:
        least, greatest = least + TOUCH, greatest - TOUCH
    if greatest < 0.0 or least >= cells:
        return 0, -1
    return int(max(0.0, math.floor(least))), int(min(cells - 1.0, math.floor(greatest)))


@compiled(nogil=True)
def _plane(polygon: np.ndarray, cell: float) -> tuple[float, float, float]:
    """Slope of a triangle's plane per column along x and along z, and |cosine| of its normal to the vertical."""
    ux, uy, uz = polygon[1, 0] - polygon[0, 0], polygon[1, 1] - polygon[0, 1], polygon[1, 2] - polygon[0, 2]
    vx, vy, vz = polygon[2, 0] - polygon[0, 0], polygon[2, 1] - polygon[0, 1], polygon[2, 2] - polygon[0, 2]
    nx, ny, nz = (uy * vz - uz * vy) * cell, (uz * vx - ux * vz) * cell * cell, (ux * vy - uy * vx) * cell
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length == 0.0 or ny == 0.0:
        return 0.0, 0.0, 0.0
    return -nx / ny * cell, -nz / ny * cell, abs(ny) / length


@compiled(nogil=True)
def _between(polygon: np.ndarray, count: int, result: np.ndarray, scratch: np.ndarray, axis: int, cell: int) -> int:
    """Clip a convex polygon to one cell along an axis; returns the number of its corners."""
    count = _half(polygon, count, scratch, axis, float(cell), 1.0)
    return _half(scratch, count, result, axis, cell + 1.0, -1.0)


@compiled(nogil=True)
def _half(polygon: np.ndarray, count: int, result: np.ndarray, axis: int, border: float, side: float) -> int:
    """Clip a convex polygon to one side of a border (Sutherland and Hodgman 1974); returns the number of corners."""
    corners = 0
    for corner in range(count):
        after = corner + 1 if corner + 1 < count else 0
        here, there = side * (polygon[corner, axis] - border), side * (polygon[after, axis] - border)
        if here >= 0.0:
            for i in range(3):
                result[corners, i] = polygon[corner, i]
            corners += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            fraction = here / (here - there)
            for i in range(3):
                result[corners, i] = polygon[corner, i] + fraction * (polygon[after, i] - polygon[corner, i])
            corners += 1
    return corners


@compiled(nogil=True)
def _insert(spans: Spans, used: int, row: int, column: int, low: float, high: float, level: float, gap: float) -> int:
    """Insert a span into a column, merged with spans nearer than `gap`; returns the number of spans in use."""
    before, span = -1, spans.first[row, column]
    while span >= 0 and spans.high[span] <= low - gap:
        before, span = span, spans.following[span]
    if span >= 0 and spans.low[span] < high + gap:
        spans.low[span] = min(spans.low[span], low)
        spans.high[span] = max(spans.high[span], high)
        spans.level[span] = max(spans.level[span], level)
        after = spans.following[span]
        while after >= 0 and spans.low[after] < spans.high[span] + gap:
            spans.high[span] = max(spans.high[span], spans.high[after])
            spans.level[span] = max(spans.level[span], spans.level[after])
            after = spans.following[after]
        spans.following[span] = after
        return used
    spans.low[used], spans.high[used], spans.level[used] = low, high, level
    spans.following[used] = span
    if before >= 0:
        spans.following[before] = used
    else:
        spans.first[row, column] = used
    return used + 1


@compiled(nogil=True)
def _nearest_tops(spans: Spans, near: float, low: float, high: float, climb: float) -> tuple[np.ndarray, np.ndarray]:
    """The walkable top of each column nearest to a height, NaN if there is none, and the bottom of the span above."""
    tops: np.ndarray = np.full(spans.first.shape, np.nan, np.float32)
    ceilings: np.ndarray = np.full(spans.first.shape, np.inf, np.float32)
    for row in range(tops.shape[0]):
        for column in range(tops.shape[1]):
            span = spans.first[row, column]
            best = np.inf
            while span >= 0:
                after, top = spans.following[span], spans.high[span]
                if low <= top <= high and top - spans.level[span] <= climb and abs(top - near) < best:
                    best = abs(top - near)
                    tops[row, column] = top
                    ceilings[row, column] = spans.low[after] if after >= 0 else np.inf
                span = after
    return tops, ceilings


@compiled(nogil=True)
def _blocked(tops: np.ndarray, ceilings: np.ndarray, climb: float, height: float) -> np.ndarray:
    """Columns without a top, and the higher one of each pair of neighbours between which the robot cannot step."""
    blocked = np.isnan(tops)
    for row in range(tops.shape[0]):
        for column in range(tops.shape[1]):
            here = tops[row, column]
            for down, right in ((1, 0), (0, 1)):
                if row + down == tops.shape[0] or column + right == tops.shape[1]:
                    continue
                there = tops[row + down, column + right]
                room = min(ceilings[row, column], ceilings[row + down, column + right]) - max(here, there)
                if abs(here - there) > climb or room < height:  # false if one of them is NaN
                    if here > there:
                        blocked[row, column] = True
                    else:
                        blocked[row + down, column + right] = True
    return blocked
