"""Ray casting on the occupancy map, to predict the camera's view from many places at once."""

import math
from dataclasses import dataclass

import numpy as np

from deux.compilation import compiled
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.mapping.occupancy import OCCUPIED, UNKNOWN

RAYS = 72
"""Default number of rays of a full circle: one every 5 degrees, four cells of 5 cm apart at 2.3 m."""

NOTHING, SURFACE, UNSEEN = 0, 1, 2
"""How a ray ends: out of range, at an occupied cell, or in unknown cells."""

GAP = 3
"""Number of consecutive unknown cells at which a ray ends; fewer are gaps between pixels."""


@dataclass(frozen=True)
class Rays:
    """The end points of R rays from each of N places. Ray r has heading `headings(R)[r]`.

    Args:
        kind: N x R uint8: `NOTHING`, `SURFACE` or `UNSEEN`.
        ends: N x R x 2 float64, world (x, z) of the centre of the occupied cell or of the first unknown one; NaN
            for `NOTHING`.
        distance: N x R float64, metres from the place to the point where the ray enters that cell; the range for
            `NOTHING`.
    """

    kind: np.ndarray
    ends: np.ndarray
    distance: np.ndarray


def headings(count: int = RAYS) -> np.ndarray:
    """Headings of the rays in radians, as in `camera_pose`: 0 along the world's -z, positive to the left."""
    return np.arange(count) * (2.0 * math.pi / count)


def cast_rays(occupancy: np.ndarray, frame: GridFrame, places: np.ndarray, max_range: float, count: int = RAYS) -> Rays:
    """Cast rays on the map in all directions.

    A ray visits every cell that it crosses (Amanatides and Woo 1987), except the first, until it meets an occupied
    cell, `GAP` consecutive unknown cells, or the end of the range or the grid.

    Args:
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        frame: position, size and resolution of the grid.
        places: N x 2 world (x, z) inside the grid.
        max_range: metres.
        count: number of rays from each place.
    """
    starts = (np.asarray(places, np.float64) - (frame.origin_x, frame.origin_z)) / frame.resolution
    directions = np.stack([-np.sin(headings(count)), -np.cos(headings(count))], axis=1)
    kind, cells, distance = _cast(occupancy, starts, directions, max_range / frame.resolution)
    ends = (frame.origin_x, frame.origin_z) + (cells + 0.5) * frame.resolution
    ends[kind == NOTHING] = np.nan
    return Rays(kind, ends, distance * frame.resolution)


def pixel_shares(camera: Camera, yaw: np.ndarray, count: int = RAYS) -> np.ndarray:
    """The share of the image's columns that each ray represents in views with given headings.

    A ray at angle a from the optical axis shows the columns from f tan(a - w / 2) to f tan(a + w / 2), w being the
    angle between rays: near the image's edges a degree covers more pixels than in its middle.

    Args:
        camera: provides the horizontal field of view.
        yaw: V float64, radians.
        count: number of rays of a full circle.

    Returns:
        V x count float64, each row sums to 1.
    """
    half_view, half_ray = math.radians(camera.hfov) / 2.0, math.pi / count
    angle = (headings(count) - np.asarray(yaw)[:, None] + math.pi) % (2.0 * math.pi) - math.pi
    first, last = (np.clip(angle + side, -half_view, half_view) for side in (-half_ray, half_ray))
    return (np.tan(last) - np.tan(first)) / (2.0 * math.tan(half_view))


@compiled
def _cast(occupancy, starts, directions, reach):  # type: ignore[no-untyped-def]
    """How each ray ends, the end point's cell (column, row) and the distance in cells."""
    rows, columns = occupancy.shape
    kind = np.zeros((len(starts), len(directions)), np.uint8)
    ends = np.zeros((len(starts), len(directions), 2), np.float64)
    distance = np.full((len(starts), len(directions)), reach)
    for n in range(len(starts)):
        for r in range(len(directions)):
            x, z = starts[n]
            dx, dz = directions[r]
            column, row = math.floor(x), math.floor(z)
            step_x, step_z = 1 if dx > 0.0 else -1, 1 if dz > 0.0 else -1
            # Distances along the ray between two crossings of the grid's lines, and to the next crossing.
            width_x = 1.0 / max(abs(dx), 1e-9)
            width_z = 1.0 / max(abs(dz), 1e-9)
            next_x = (column + 1 - x if dx > 0.0 else x - column) * width_x
            next_z = (row + 1 - z if dz > 0.0 else z - row) * width_z
            unknown = 0
            while True:
                travelled = min(next_x, next_z)
                if next_x < next_z:
                    column += step_x
                    next_x += width_x
                else:
                    row += step_z
                    next_z += width_z
                if travelled > reach or row < 0 or row >= rows or column < 0 or column >= columns:
                    break
                cell = occupancy[row, column]
                if cell == OCCUPIED:
                    kind[n, r] = SURFACE
                elif cell == UNKNOWN:
                    unknown += 1
                else:
                    unknown = 0
                if unknown == 1 or cell == OCCUPIED:
                    ends[n, r, 0], ends[n, r, 1] = column, row
                    distance[n, r] = travelled
                if unknown == GAP:
                    kind[n, r] = UNSEEN
                if kind[n, r] != NOTHING:
                    break
            if kind[n, r] == NOTHING:
                distance[n, r] = reach
    return kind, ends, distance
