"""The robot's body on the floor: a disc that slides along straight walls and never leaves the free floor."""

import math
from typing import NamedTuple

import numpy as np

from deux.compilation import compiled
from deux.geometry.grid import FreeSpace, GridFrame
from deux.simulator.wall_segments import is_clear, wall_segments

MARGIN = 1e-6  # cells from a wall at which the body comes to rest
SLACK = 1e-5  # cells behind a wall, or beyond its end, at which it still stops the body
TILE = 8  # cells; walls are looked up by square tiles of the grid
LEG = 4.0  # cells that the body moves at most between two looks at the tiles
MOST_LEGS = 200  # of one move; it takes a few, so that this only guards against rounding


class Walls(NamedTuple):
    """The walls around the free floor, in cells, ready for motion.

    Args:
        free: rows x columns bool, true where the centre of the body may be; a ring of cells around the grid is false.
        starts: S x 2 float64, as (x, y).
        directions: S x 2 float64, unit vectors; the floor is on the side of (-uy, ux).
        lengths: S float64.
        first: index into `near` of each tile's first wall, row by row of tiles, and the number of walls at the end.
        near: indices of walls that a body may touch by a leg from a point in the tile.
        tiles_across: tiles in a row of tiles.
    """

    free: np.ndarray
    starts: np.ndarray
    directions: np.ndarray
    lengths: np.ndarray
    first: np.ndarray
    near: np.ndarray
    tiles_across: int


class Body:
    """A disc on the free floor. The cells are those where its centre may be, so it is handled as a point.

    It moves like Habitat-Sim's agent: straight on as far as it can, and then along the walls to the place that is
    nearest to where it was told to go. Walls are those of `wall_segments`. The floor's cells reach a little behind
    slanted walls; a body that was put there goes to the nearest place before the wall first.

    Args:
        free_space: where it may be.
    """

    def __init__(self, free_space: FreeSpace) -> None:
        self._frame: GridFrame = free_space.frame
        self._free = free_space.free
        self._walls = _walls(free_space.free)

    def stands_at(self, x: float, z: float) -> bool:
        """Whether the body may be at world (x, z), metres."""
        rows, columns = self._frame.cells(x, z)
        return bool(self._frame.contains(rows, columns) and self._free[rows, columns])

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
        column, row = (x - self._frame.origin_x) / cell, (z - self._frame.origin_z) / cell
        forward = distance / cell
        column, row = _move(self._walls, column, row, -math.sin(yaw) * forward, -math.cos(yaw) * forward)
        new_x = self._frame.origin_x + column * cell
        new_z = self._frame.origin_z + row * cell
        moved = (new_x - x) ** 2 + (new_z - z) ** 2
        return new_x, new_z, moved + 1e-5 < distance**2


def _walls(free: np.ndarray) -> Walls:
    starts, ends = wall_segments(free)
    # A ring of cells is added, so that no look at a cell can be outside the array.
    padded, starts, along = np.pad(free, 1), starts + 1.0, ends - starts
    lengths = np.linalg.norm(along, axis=1)
    tiles_down, tiles_across = (math.ceil(size / TILE) for size in padded.shape)
    first, near = _tiles(starts, along, tiles_down, tiles_across)
    return Walls(padded, starts, along / lengths[:, None], lengths, first, near, tiles_across)


def _tiles(starts: np.ndarray, along: np.ndarray, tiles_down: int, tiles_across: int) -> tuple[np.ndarray, np.ndarray]:
    """`Walls.first` and `Walls.near`: which of S walls are near which tile; a few are farther away than necessary."""
    # Points on each wall, a tile's edge apart at most; every place on it is within half of that of one of them.
    steps = np.ceil(np.linalg.norm(along, axis=1) / TILE).astype(np.int64)
    wall = np.repeat(np.arange(len(starts)), steps + 1)
    number = np.arange(len(wall)) - np.repeat(np.cumsum(steps + 1) - (steps + 1), steps + 1)
    points = starts[wall] + along[wall] * (number / steps[wall])[:, None]
    reach = LEG + TILE / 2.0 + 1.0
    low = np.floor((points - reach) / TILE).astype(np.int64)
    across, down = np.divmod(np.arange((math.ceil(2.0 * reach / TILE) + 1) ** 2), math.ceil(2.0 * reach / TILE) + 1)
    columns, rows = low[:, :1] + across, low[:, 1:] + down
    inside = (columns >= 0) & (columns < tiles_across) & (rows >= 0) & (rows < tiles_down)
    tile = (rows * tiles_across + columns)[inside]
    pairs = np.unique(tile * len(starts) + np.broadcast_to(wall[:, None], rows.shape)[inside])
    first = np.searchsorted(pairs, np.arange(tiles_down * tiles_across + 1) * len(starts))
    return first, pairs % max(len(starts), 1)


@compiled(nogil=True)
def _move(walls: Walls, x: float, y: float, dx: float, dy: float) -> tuple[float, float]:
    """Move a point by (dx, dy), in cells; returns where it comes to rest."""
    x, y = x + 1.0, y + 1.0  # the ring of cells
    rows, columns = walls.free.shape
    if not (0.0 <= x < columns and 0.0 <= y < rows and walls.free[math.floor(y), math.floor(x)]):
        return x - 1.0, y - 1.0
    distance = math.hypot(dx, dy)
    at_x, at_y = _before_walls(walls, x, y)
    back = math.hypot(at_x - x, at_y - y)
    if back > distance:
        at_x, at_y = x + (at_x - x) * distance / back, y + (at_y - y) * distance / back
    else:
        at_x, at_y = _approach(walls, at_x, at_y, x + dx, y + dy, x, y, distance)
    return at_x - 1.0, at_y - 1.0


@compiled(nogil=True)
def _approach(
    walls: Walls, x: float, y: float, to_x: float, to_y: float, from_x: float, from_y: float, distance: float
) -> tuple[float, float]:
    """Bring a point as near to (to_x, to_y) as walls permit, and not farther than `distance` from (from_x, from_y)."""
    wall = -1  # along which it slides
    for _ in range(MOST_LEGS):
        left_x, left_y = to_x - x, to_y - y
        left = math.hypot(left_x, left_y)
        end = math.inf
        if wall >= 0:
            ux, uy = walls.directions[wall]
            along = left_x * ux + left_y * uy
            left_x, left_y, left = along * ux, along * uy, abs(along)
            done = (x - walls.starts[wall, 0]) * ux + (y - walls.starts[wall, 1]) * uy
            end = 2.0 * SLACK + (walls.lengths[wall] - done if along > 0.0 else done)
        if left < MARGIN:
            break
        heading_x, heading_y = left_x / left, left_y / left
        leg = min(left, end, LEG)
        hit, way = _first_wall(walls, x, y, heading_x, heading_y, leg, wall)
        farthest = _to_circle(x - from_x, y - from_y, heading_x, heading_y, distance)
        x, y = x + min(way, farthest) * heading_x, y + min(way, farthest) * heading_y
        if farthest < way or (hit < 0 and leg == left):
            break
        if hit >= 0:
            if wall >= 0 and _leads_into(walls, hit, wall, to_x - x, to_y - y):
                break
            wall = hit
        elif leg == end:
            wall = -1  # round the corner there may be a straight way again
    return x, y


@compiled(nogil=True)
def _leads_into(walls: Walls, wall: int, other: int, left_x: float, left_y: float) -> bool:
    """Whether the way along `wall`, with (left_x, left_y) left to go, leads behind the `other` one."""
    ux, uy = walls.directions[wall]
    other_ux, other_uy = walls.directions[other]
    return (left_x * ux + left_y * uy) * (uy * other_ux - ux * other_uy) < 0.0


@compiled(nogil=True)
def _to_circle(x: float, y: float, heading_x: float, heading_y: float, radius: float) -> float:
    """How far a point goes along a heading until it leaves the circle around the origin; it is not outside."""
    along = x * heading_x + y * heading_y
    # The margin is for rounding: a straight way ends on the circle.
    return math.sqrt(max(0.0, along * along + radius * radius - x * x - y * y)) - along + 1e-9


@compiled(nogil=True)
def _first_wall(
    walls: Walls, x: float, y: float, heading_x: float, heading_y: float, leg: float, left_out: int
) -> tuple[int, float]:
    """The wall that stops a point first within `leg` cells, -1 for none, and how far it goes until then."""
    hit, way = -1, leg
    tile = int(y / TILE) * walls.tiles_across + int(x / TILE)
    for wall in walls.near[walls.first[tile] : walls.first[tile + 1]]:
        ux, uy = walls.directions[wall]
        nearing = heading_x * uy - heading_y * ux
        if nearing < 1e-12 or wall == left_out:
            continue
        from_x, from_y = x - walls.starts[wall, 0], y - walls.starts[wall, 1]
        before = from_y * ux - from_x * uy
        if before < -SLACK:
            continue
        to_wall = max(0.0, (before - MARGIN) / nearing)
        place = from_x * ux + from_y * uy + to_wall * (heading_x * ux + heading_y * uy)
        if to_wall < way and -SLACK <= place <= walls.lengths[wall] + SLACK:
            hit, way = wall, to_wall
    return hit, way


@compiled(nogil=True)
def _before_walls(walls: Walls, x: float, y: float) -> tuple[float, float]:
    """The nearest place to a point on free cells that is not behind a wall: the same place in most cases."""
    nearest, side = math.inf, 0.0
    place_x, place_y = x, y
    tile = int(y / TILE) * walls.tiles_across + int(x / TILE)
    for wall in walls.near[walls.first[tile] : walls.first[tile + 1]]:
        ux, uy = walls.directions[wall]
        from_x, from_y = x - walls.starts[wall, 0], y - walls.starts[wall, 1]
        before = from_y * ux - from_x * uy
        along = min(max(from_x * ux + from_y * uy, 0.0), walls.lengths[wall])
        wall_x, wall_y = walls.starts[wall, 0] + along * ux, walls.starts[wall, 1] + along * uy
        distance = math.hypot(wall_x - x, wall_y - y)
        # Of two walls that meet in the nearest place, the one that is farther aside decides.
        if distance > nearest + 1e-9 or (distance > nearest - 1e-9 and abs(before) <= abs(side)):
            continue
        if before < 0.0 and not is_clear(walls.free, x, y, wall_x, wall_y):
            continue  # the back of another room's wall
        nearest, side = distance, before
        place_x, place_y = wall_x - MARGIN * uy, wall_y + MARGIN * ux
    return (place_x, place_y) if side < 0.0 else (x, y)
