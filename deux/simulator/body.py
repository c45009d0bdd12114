"""Motion of the robot's body: a disc that slides along straight walls and stays on the free floor."""

import math
from typing import NamedTuple

import numpy as np

from deux.compilation import compiled
from deux.geometry.grid import FreeSpace, GridFrame
from deux.simulator.wall_segments import is_clear, wall_segments

MARGIN = 1e-6  # cells; distance from a wall at which the body stops
SLACK = 1e-5  # cells behind a wall, or beyond its end, up to which the wall still stops the body
TILE = 8  # cells; edge of the square tiles by which nearby walls are looked up
LEG = 4.0  # cells; greatest distance between two lookups
MOST_LEGS = 200  # bound on the legs of one move, which takes a few; a guard against endless loops by rounding


class Walls(NamedTuple):
    """The walls around the free floor, in cells, indexed by tiles.

    Args:
        free: rows x columns bool, the cells where the centre of the body may be; padded by one cell on all sides.
        starts: S x 2 float64, (x, y) of the walls' starts.
        directions: S x 2 float64, unit vectors; the floor is on the side of (-uy, ux).
        lengths: S float64.
        first: index in `near` of each tile's first wall, in row-major order, and the number of walls at the end.
        near: indices of the walls that a body in the tile may hit within one leg.
        tiles_across: number of tiles in a row.
    """

    free: np.ndarray
    starts: np.ndarray
    directions: np.ndarray
    lengths: np.ndarray
    first: np.ndarray
    near: np.ndarray
    tiles_across: int


class Body:
    """A disc on the free floor, simulated as a point because free cells are those where its centre may be.

    It moves like Habitat-Sim's agent: straight ahead as far as possible, and then along the walls to the point nearest
    to the target. The walls are those of `wall_segments`. Free cells extend slightly behind slanted walls; a body there
    moves to the nearest point in front of the wall first.

    Args:
        free_space: the free floor.
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
        """Move forward, sliding along walls.

        Along a wall at an angle to the heading the body moves by `distance` x cos(angle), as in Habitat-Sim.

        Args:
            x: world x of the centre in metres; a body that is not on free floor does not move.
            z: world z of the centre in metres.
            yaw: heading in radians, 0 looks along -Z, positive to the left.
            distance: the distance to move in metres.

        Returns:
            World x and z after the move, and whether the body collided, sliding included: |moved|^2 + 1e-5 <
            distance^2.
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
    # Padding by one cell, so that lookups never leave the array.
    padded, starts, along = np.pad(free, 1), starts + 1.0, ends - starts
    lengths = np.linalg.norm(along, axis=1)
    tiles_down, tiles_across = (math.ceil(size / TILE) for size in padded.shape)
    first, near = _tiles(starts, along, tiles_down, tiles_across)
    return Walls(padded, starts, along / lengths[:, None], lengths, first, near, tiles_across)


def _tiles(starts: np.ndarray, along: np.ndarray, tiles_down: int, tiles_across: int) -> tuple[np.ndarray, np.ndarray]:
    """Compute `Walls.first` and `Walls.near` for S walls; a few of the walls are farther away than necessary."""
    # Points on each wall, at most a tile's edge apart: every place on it is within half of that of one of them.
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
    """Move a point by (dx, dy), in cells; returns its position afterwards."""
    x, y = x + 1.0, y + 1.0  # the padding
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
    """Move a point as near to (to_x, to_y) as the walls permit, at most `distance` away from (from_x, from_y)."""
    wall = -1  # the wall along which it slides
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
            wall = -1  # beyond the wall's end the straight way may be free again
    return x, y


@compiled(nogil=True)
def _leads_into(walls: Walls, wall: int, other: int, left_x: float, left_y: float) -> bool:
    """Whether sliding along `wall`, with the remaining way (left_x, left_y), leads behind the `other` wall."""
    ux, uy = walls.directions[wall]
    other_ux, other_uy = walls.directions[other]
    return (left_x * ux + left_y * uy) * (uy * other_ux - ux * other_uy) < 0.0


@compiled(nogil=True)
def _to_circle(x: float, y: float, heading_x: float, heading_y: float, radius: float) -> float:
    """Distance from a point inside the circle around the origin, along a heading, to the circle."""
    along = x * heading_x + y * heading_y
    # The margin is for rounding errors: a straight way ends on the circle.
    return math.sqrt(max(0.0, along * along + radius * radius - x * x - y * y)) - along + 1e-9


@compiled(nogil=True)
def _first_wall(
    walls: Walls, x: float, y: float, heading_x: float, heading_y: float, leg: float, left_out: int
) -> tuple[int, float]:
    """The first wall that a point hits within `leg` cells, -1 for none, and the distance to it."""
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
    """The place nearest to a point on free cells that is not behind a wall; usually the point itself."""
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
        # If two walls meet at the nearest place, the one whose line is farther away decides.
        if distance > nearest + 1e-9 or (distance > nearest - 1e-9 and abs(before) <= abs(side)):
            continue
        if before < 0.0 and not is_clear(walls.free, x, y, wall_x, wall_y):
            continue  # a wall of another room, seen from behind
        nearest, side = distance, before
        place_x, place_y = wall_x - MARGIN * uy, wall_y + MARGIN * ux
    return (place_x, place_y) if side < 0.0 else (x, y)
