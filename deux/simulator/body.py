"""The robot's body on the floor: a disc that slides along walls and never leaves the free floor."""

import math
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from deux.compilation import compiled
from deux.geometry.grid import FreeSpace, GridFrame

SUBSTEP = 0.1  # of a cell: how far the body moves between two looks at the floor
LARGEST_DETOUR = 1.5  # cells away from the wall, to get over the stairs that a slanted wall is on a grid
SMOOTHING = 2.0  # cells; the direction of a wall is judged over about twice as many


class Ground(NamedTuple):
    """The free floor, ready for motion.

    Args:
        free: rows x columns bool, true where the centre of the body may be.
        away: rows x columns x 2 float64, unit vector (along columns, along rows) away from the nearest wall.
    """

    free: np.ndarray
    away: np.ndarray


class Body:
    """A disc on the free floor. The cells are those where its centre may be, so it is handled as a point.

    Args:
        free_space: where it may be.
    """

    def __init__(self, free_space: FreeSpace) -> None:
        self._frame: GridFrame = free_space.frame
        self._ground = _ground(free_space.free)

    def stands_at(self, x: float, z: float) -> bool:
        """Whether the body may be at world (x, z), metres."""
        rows, columns = self._frame.cells(x, z)
        return bool(self._frame.contains(rows, columns) and self._ground.free[rows, columns])

    def move(self, x: float, z: float, yaw: float, distance: float) -> tuple[float, float, bool]:
        """Move forward, sliding along what is in the way.

        Along a wall at an angle to the heading the body moves by `distance` x cos(angle), as in Habitat-Sim.

        Args:
            x: world x of the centre in metres; a body that is not on free floor stays where it is.
            z: world z of the centre in metres.
            yaw: heading in radians, 0 looks along -Z, positive to the left.
            distance: how far to go in metres.

        Returns:
            World x and z of where the body comes to rest, and whether it moved less than it was told to, which a
            slide does too: |moved|^2 + 1e-5 < |asked|^2.
        """
        cell = self._frame.resolution
        column, row = _slide(
            self._ground,
            (x - self._frame.origin_x) / cell,
            (z - self._frame.origin_z) / cell,
            -math.sin(yaw),
            -math.cos(yaw),
            distance / cell,
        )
        new_x = self._frame.origin_x + _off_border(column) * cell
        new_z = self._frame.origin_z + _off_border(row) * cell
        moved = (new_x - x) ** 2 + (new_z - z) ** 2
        return new_x, new_z, moved + 1e-5 < distance**2


def _off_border(coordinate: float) -> float:
    """The same place in cells, at least a millionth inside: on a border rounding decides which cell it is in."""
    cell = math.floor(coordinate)
    return min(max(coordinate, cell + 1e-6), cell + 1.0 - 1e-6)


def _ground(free: np.ndarray) -> Ground:
    # Outside the grid nothing is free.
    padded = np.pad(free, 1)
    distance = ndimage.distance_transform_edt(padded) - ndimage.distance_transform_edt(~padded)
    smooth = ndimage.gaussian_filter(distance, SMOOTHING)[1:-1, 1:-1]
    down, across = np.gradient(smooth)
    away = np.stack([across, down], axis=-1)
    return Ground(free, away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9))


@compiled(nogil=True)
def _is_free(free: np.ndarray, column: int, row: int) -> bool:
    return 0 <= row < free.shape[0] and 0 <= column < free.shape[1] and free[row, column]


@compiled(nogil=True)
def _can_go(free: np.ndarray, x: float, y: float, dx: float, dy: float) -> bool:
    """Whether a point at (x, y), in cells, can go by (dx, dy), each less than a cell, in a straight line."""
    column, row = math.floor(x), math.floor(y)
    new_column, new_row = math.floor(x + dx), math.floor(y + dy)
    if not _is_free(free, new_column, new_row):
        return False
    # Two cells that touch at a corner only are no passage.
    return (
        new_column == column or new_row == row or (_is_free(free, column, new_row) and _is_free(free, new_column, row))
    )


@compiled(nogil=True)
def _slide(
    ground: Ground, x: float, y: float, heading_x: float, heading_y: float, distance: float
) -> tuple[float, float]:
    """Move a point by `distance` along a heading, all in cells, along the wall where one is in the way."""
    steps = max(1, math.ceil(distance / SUBSTEP))
    step_x, step_y = distance / steps * heading_x, distance / steps * heading_y
    start_x, start_y = x, y
    if not _is_free(ground.free, math.floor(x), math.floor(y)):
        return x, y
    for _ in range(steps):
        new_x, new_y = x + step_x, y + step_y
        if not _can_go(ground.free, x, y, step_x, step_y):
            away_x, away_y = ground.away[math.floor(y), math.floor(x)]
            into = min(0.0, step_x * away_x + step_y * away_y)
            along_x, along_y = step_x - into * away_x, step_y - into * away_y
            back = _detour(ground.free, x, y, along_x, along_y, away_x, away_y)
            if back < 0.0:
                break
            new_x, new_y = x + back * away_x + along_x, y + back * away_y + along_y
        # Detours must not carry the body farther than it was told to go; the margin is for rounding.
        if math.hypot(new_x - start_x, new_y - start_y) > distance + 1e-9:
            break
        x, y = new_x, new_y
    return x, y


@compiled(nogil=True)
def _detour(
    free: np.ndarray, x: float, y: float, along_x: float, along_y: float, away_x: float, away_y: float
) -> float:
    """How many cells a point must first back away from the wall to go along it; -1 if that does not help."""
    back = 0.0
    while back <= LARGEST_DETOUR:
        at_x, at_y = x + back * away_x, y + back * away_y
        if _can_go(free, at_x, at_y, along_x, along_y):
            return back
        if not _can_go(free, at_x, at_y, SUBSTEP * away_x, SUBSTEP * away_y):
            break
        back += SUBSTEP
    return -1.0
