"""A room with boxes in it, seen along rays and walked on: what the stand-in for Habitat-Sim has in place of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Box:
    """A box in the world, in metres; the room itself is one that is seen from inside."""

    low: np.ndarray
    high: np.ndarray
    category: str
    number: int  # 0 for the room

    def turned(self, rotation: np.ndarray) -> Box:
        corners = np.stack([rotation @ self.low, rotation @ self.high])
        return Box(corners.min(axis=0), corners.max(axis=0), self.category, self.number)


def cast(
    boxes: list[Box], origin: np.ndarray, rays: np.ndarray, near: float, far: float
) -> tuple[np.ndarray, np.ndarray]:
    """What N rays meet first; back faces are not seen.

    Args:
        boxes: the room first.
        origin: 3, metres.
        rays: N x 3, of length 1 along the optical axis.
        near: nearest depth in metres.
        far: farthest depth in metres.

    Returns:
        Depth along the optical axis, inf where nothing is met, and the number of the box; N each.
    """
    depth, number = np.full(len(rays), np.inf), np.zeros(len(rays), np.int64)
    safe = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    for box in boxes:
        inward = -1.0 if box.number == 0 else 1.0
        for axis in range(3):
            others = [a for a in range(3) if a != axis]
            for side, outward in ((box.low, -1.0), (box.high, 1.0)):
                t = (side[axis] - origin[axis]) / safe[:, axis]
                points = origin[others] + t[:, None] * rays[:, others]
                hit = ((points >= box.low[others]) & (points <= box.high[others])).all(axis=1)
                hit &= (rays[:, axis] * outward * inward < 0.0) & (t >= near) & (t <= far)
                nearer = hit & (t < depth)
                depth[nearer], number[nearer] = t[nearer], box.number
    return depth, number


@dataclass(frozen=True)
class Rectangle:
    """A level piece of the navmesh."""

    x0: float
    z0: float
    x1: float
    z1: float
    y: float
    island: int = 0

    def touches(self, other: Rectangle) -> bool:
        """Whether the two share more than a corner."""
        along_x = min(self.x1, other.x1) - max(self.x0, other.x0)
        along_z = min(self.z1, other.z1) - max(self.z0, other.z0)
        return self.y == other.y and min(along_x, along_z) > -1e-9 and max(along_x, along_z) > 1e-9


def navmesh(
    boxes: list[Box], cell_size: float, radius: float, height: float, max_climb: float, cell_height: float
) -> list[Rectangle]:
    """The level surfaces where a robot's centre can be: the floor, and the tops of boxes with room above them.

    Walls take up whole cells, counted from the room's least corner: the one that they begin in and the one that they
    end in, even where that is on the edge between two.

    Args:
        boxes: the room first.
        cell_size: of the voxels, metres.
        radius: of the robot, metres; rounded up to cells.
        height: of the robot, metres.
        max_climb: the highest step in metres.
        cell_height: of the voxels, metres.
    """
    room, others = boxes[0], boxes[1:]
    bottom, top = room.low[1], room.high[1]
    if top - bottom < height:
        return []
    radius = math.ceil(radius / cell_size - 1e-6) * cell_size

    def cells(box: Box) -> tuple[np.ndarray, np.ndarray]:
        first = np.floor((box.low - room.low)[[0, 2]] / cell_size + 1e-6) * cell_size
        last = (np.floor((box.high - room.low)[[0, 2]] / cell_size + 1e-6) + 1.0) * cell_size
        return first + room.low[[0, 2]], last + room.low[[0, 2]]

    blocked = []
    for box in others:
        if box.high[1] > bottom + max_climb and box.low[1] < bottom + height:
            first, last = cells(box)
            blocked.append((first - radius, last + radius))
    margin = cell_size + radius
    floor = _rounded_up(bottom, bottom, cell_height)
    pieces = _free_rectangles(room.low[[0, 2]] + margin, room.high[[0, 2]] - margin, blocked, floor)
    for box in others:
        low, high = box.low + radius, box.high - radius
        if top - box.high[1] >= height and (low < high)[[0, 2]].all():
            pieces.append(Rectangle(low[0], low[2], high[0], high[2], _rounded_up(box.high[1], bottom, cell_height)))
    return _with_islands(pieces)


def _rounded_up(y: float, bottom: float, cell_height: float) -> float:
    """The top of the voxel that a surface is in: at least one cell above the scene's lowest point."""
    return bottom + cell_height * max(1, math.ceil((y - bottom) / cell_height - 1e-6))


def _free_rectangles(
    low: np.ndarray, high: np.ndarray, blocked: list[tuple[np.ndarray, np.ndarray]], y: float
) -> list[Rectangle]:
    """A rectangle from `low` to `high` (x and z) without the blocked ones, cut along all edges."""
    cuts = []
    for axis in (0, 1):
        edges = [low[axis], high[axis], *(edge[axis] for pair in blocked for edge in pair)]
        cuts.append(np.unique(np.clip(edges, low[axis], high[axis])))
    return [
        Rectangle(x0, z0, x1, z1, y)
        for x0, x1 in zip(cuts[0], cuts[0][1:], strict=False)
        for z0, z1 in zip(cuts[1], cuts[1][1:], strict=False)
        if not any(first[0] < (x0 + x1) / 2 < last[0] and first[1] < (z0 + z1) / 2 < last[1] for first, last in blocked)
    ]


def _with_islands(pieces: list[Rectangle]) -> list[Rectangle]:
    """The same rectangles, numbered by connected component."""
    islands = list(range(len(pieces)))
    changed = True
    while changed:
        changed = False
        for first, one in enumerate(pieces):
            for second, other in enumerate(pieces[:first]):
                if islands[first] != islands[second] and one.touches(other):
                    islands[first] = islands[second] = min(islands[first], islands[second])
                    changed = True
    names = {name: number for number, name in enumerate(sorted(set(islands)))}
    return [
        Rectangle(one.x0, one.z0, one.x1, one.z1, one.y, names[name]) for one, name in zip(pieces, islands, strict=True)
    ]
