"""Floor plans of houses: wings along corridors, nested rooms, and wide openings between large rooms."""

import math
from dataclasses import dataclass
from itertools import combinations

from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.floor_plan import (
    CORNER_MARGIN,
    WALL,
    Cell,
    FloorPlan,
    Opening,
    Room,
    cell_room,
    shared_wall,
    windows_in_wall,
)

LEAST_ROOMS, MOST_ROOMS = 8, 25
DOOR_HEIGHT = 2.05
LEAST_SIDE = 180
"""Least width of a room between the middle lines of its walls, centimetres."""

LEAST_WING = 220
"""Least breadth of the wings on both sides of a corridor, centimetres."""

LONGEST = 3.2
"""Greatest ratio of a room's sides; corridors are longer."""

PRIVATE = frozenset({"bathroom", "closet", "storeroom"})
"""Rooms with one door, which are not on the way to other rooms."""

OPEN_PLAN = frozenset({"living room", "dining room", "kitchen", "hall", "workroom"})
"""Rooms that may be connected by an opening as wide as the wall between them."""

KINDS: tuple[tuple[float, tuple[str, ...]], ...] = (
    (6.5, ("closet", "closet", "storeroom", "bathroom")),
    (13.0, ("bedroom", "study", "bathroom", "storeroom", "bedroom", "study")),
    (24.0, ("bedroom", "bedroom", "study", "dining room", "library", "workroom")),
    (38.0, ("living room", "library", "dining room", "workroom", "hall")),
    (1e9, ("hall", "hall", "workroom", "living room")),
)
"""Kinds of rooms up to each area in square metres."""

NEEDED = (("living room", 28.0), ("kitchen", 15.0), ("bathroom", 7.0), ("bedroom", 14.0), ("library", 20.0))
"""Kinds of rooms that every house has, and the preferred area of each in square metres."""


@dataclass(frozen=True)
class _Part:
    """A rectangle of the plan, bounded by the middle lines of its walls, and whether it is a corridor."""

    cell: Cell
    corridor: bool = False

    @property
    def area(self) -> float:
        x0, z0, x1, z1 = self.cell
        return (x1 - x0) * (z1 - z0) / 1e4


def make_house_plan(draws: Draws, least: float, most: float) -> FloorPlan:
    """Draw a plan of 8 to 25 rooms, all connected by doorways.

    Args:
        draws: the random numbers.
        least: least total area of the rooms, square metres.
        most: greatest total area.
    """
    while True:
        target = draws.uniform(least, most)
        parts = _drop_corner(_divided(target, draws), draws)
        area = sum(cell_room("", part.cell, 0.0).area for part in parts)
        if not (LEAST_ROOMS <= len(parts) <= MOST_ROOMS and least <= area <= most):
            continue
        kinds = _kinds(parts, draws)
        heights = _heights(parts, kinds, draws)
        doors = _doors([part.cell for part in parts], kinds, heights, draws)
        if doors is not None:
            break
    rooms = tuple(cell_room(kind, part.cell, height) for kind, part, height in zip(kinds, parts, heights, strict=True))
    windows = _windows([part.cell for part in parts], rooms, draws)
    return FloorPlan(rooms, tuple(doors), tuple(windows), _entrance([part.cell for part in parts], kinds))


def _divided(target: float, draws: Draws) -> list[_Part]:
    """Divide a rectangle of about this area into wings along corridors, and wings into rooms of different sizes."""
    gross, ratio = target * 1.05, draws.uniform(0.5, 1.0)
    depth = round(math.sqrt(gross * ratio) * 10) * 10
    width = round(gross / depth * 1e3) * 10
    room_area = max(target / draws.uniform(8.0, 18.0), 10.0)
    parts: list[_Part] = []
    waiting = [((0, 0, width, depth), 0)]
    while waiting:
        cell, level = waiting.pop()
        part = _Part(cell)
        if _wants_corridor(cell, level, draws):
            near, corridor, far = _cut_corridor(cell, draws)
            parts.append(_Part(corridor, corridor=True))
            waiting += [(near, level + 1), (far, level + 1)]
            continue
        size = room_area * draws.choice((0.5, 0.8, 1.1, 1.1, 1.5, 2.6))
        short, long = sorted((cell[2] - cell[0], cell[3] - cell[1]))
        halves = _halves(cell, draws) if part.area > size or long > LONGEST * short else None
        if halves is None:
            parts.append(part)
        else:
            waiting += [(half, level + 1) for half in halves]
    return parts


def _wants_corridor(cell: Cell, level: int, draws: Draws) -> bool:
    width, depth = cell[2] - cell[0], cell[3] - cell[1]
    if min(width, depth) < 2 * LEAST_WING + 260 or width * depth < 60_0000:
        return False
    return draws.chance(0.9 if level == 0 else 0.5)


def _cut_corridor(cell: Cell, draws: Draws) -> tuple[Cell, Cell, Cell]:
    """Cut a cell by a corridor, usually along its longer side: (near wing, corridor, far wing)."""
    x0, z0, x1, z1 = cell
    along_x = (x1 - x0 >= z1 - z0) == draws.chance(0.8)
    across = (z1 - z0) if along_x else (x1 - x0)
    breadth = draws.choice((150, 160, 180, 210, 260))
    near = round((across - breadth) * draws.uniform(0.36, 0.64) / 10) * 10
    near = min(max(near, LEAST_WING), across - breadth - LEAST_WING)
    if along_x:
        return (x0, z0, x1, z0 + near), (x0, z0 + near, x1, z0 + near + breadth), (x0, z0 + near + breadth, x1, z1)
    return (x0, z0, x0 + near, z1), (x0 + near, z0, x0 + near + breadth, z1), (x0 + near + breadth, z0, x1, z1)


def _halves(cell: Cell, draws: Draws) -> tuple[Cell, Cell] | None:
    """Cut a cell across its longer side into two unequal rooms, or None if it is too short."""
    x0, z0, x1, z1 = cell
    across_x = (x1 - x0) * draws.uniform(0.8, 1.25) >= (z1 - z0)
    length = (x1 - x0) if across_x else (z1 - z0)
    if length < 2 * LEAST_SIDE:
        return None
    cut = min(max(round(length * draws.uniform(0.25, 0.75) / 10) * 10, LEAST_SIDE), length - LEAST_SIDE)
    if across_x:
        return (x0, z0, x0 + cut, z1), (x0 + cut, z0, x1, z1)
    return (x0, z0, x1, z0 + cut), (x0, z0 + cut, x1, z1)


def _drop_corner(parts: list[_Part], draws: Draws) -> list[_Part]:
    """Remove a room at a corner of the rectangle in two of three houses."""
    if not draws.chance(0.67):
        return parts
    width, depth = max(part.cell[2] for part in parts), max(part.cell[3] for part in parts)
    corners = [
        part
        for part in parts
        if not part.corridor and part.cell[0] * (width - part.cell[2]) == 0 == part.cell[1] * (depth - part.cell[3])
    ]
    dropped = draws.choice(corners) if corners else None
    return [part for part in parts if part is not dropped]


def _kinds(parts: list[_Part], draws: Draws) -> list[str]:
    """The kind of each room: first the kinds that every house needs, then the others by area."""
    kinds = ["corridor" if part.corridor else "" for part in parts]
    for kind, area in NEEDED:
        free = [index for index, use in enumerate(kinds) if not use]
        if free:
            kinds[min(free, key=lambda index: abs(parts[index].area - area))] = kind
    for index, part in enumerate(parts):
        if not kinds[index]:
            kinds[index] = draws.choice(next(uses for most, uses in KINDS if part.area <= most))
    return kinds


def _heights(parts: list[_Part], kinds: list[str], draws: Draws) -> list[float]:
    """The height of each ceiling: one for the house, higher in large rooms, lower in some closets and corridors."""
    usual = draws.choice((2.5, 2.6, 2.7, 2.9))
    heights = []
    for part, kind in zip(parts, kinds, strict=True):
        height = usual
        if part.area > 32.0 and kind != "corridor":
            height += draws.choice((0.0, 0.4, 0.8, 1.3))
        elif kind in PRIVATE or kind == "corridor":
            height -= draws.choice((0.0, 0.0, 0.1))
        heights.append(round(height, 2))
    return heights


def _doors(cells: list[Cell], kinds: list[str], heights: list[float], draws: Draws) -> list[Opening] | None:
    """Draw doorways along a random spanning tree, and some more; None if the rooms cannot all be connected."""
    shared = []
    for a, b in combinations(range(len(cells)), 2):
        wall = shared_wall(cells[a], cells[b])
        if wall is not None:
            private = sum(kinds[index] in PRIVATE for index in (a, b))
            corridors = sum(kinds[index] == "corridor" for index in (a, b))
            shared.append((draws.uniform(0.0, 1.0) + 0.9 * private - (0.0, 0.3, 2.0)[corridors], a, b, wall))
    group = list(range(len(cells)))
    doors: list[Opening] = []
    for _, a, b, wall in sorted(shared, key=lambda item: item[0]):
        joins = group[a] != group[b]
        group = [group[a] if member == group[b] else member for member in group]
        wide = {kinds[a], kinds[b]} <= OPEN_PLAN
        more = 0.0 if PRIVATE & {kinds[a], kinds[b]} else 0.7 if wide else 0.22
        if joins or draws.chance(more):
            top = min(heights[a], heights[b]) - 0.2
            doors.append(_doorway(a, b, wall, kinds, top, draws))
    return doors if len(set(group)) == 1 else None


def _doorway(
    a: int, b: int, wall: tuple[str, int, int, int, bool], kinds: list[str], top: float, draws: Draws
) -> Opening:
    """Draw a doorway in a wall, or a wide opening up to the height `top` between two rooms of an open plan."""
    axis, coordinate, start, end, swapped = wall
    margin = CORNER_MARGIN + WALL / 2
    room = (end - start) / 100 - 2 * margin
    uses = {kinds[a], kinds[b]}
    if uses <= OPEN_PLAN and draws.chance(0.75):
        width, top = min(room, draws.uniform(2.0, 5.0)), min(top, 2.45)
    elif "corridor" in uses and (len(uses) == 1 or (uses & OPEN_PLAN and draws.chance(0.5))):
        width, top = min(room, draws.choice((1.2, 1.6, 2.0))), min(top, 2.3)
    else:
        width, top = draws.choice((0.9, 0.95, 1.0)), DOOR_HEIGHT
    width = min(width, max(room, 0.9))
    # Doors near a corner leave long walls for furniture.
    place = draws.choice((0.0, 0.0, 1.0, 1.0, draws.uniform(0.0, 1.0)))
    low = round(start / 100 + margin + (room - width) * place, 2)
    rooms = (b, a) if swapped else (a, b)
    return Opening(axis, coordinate / 100, low, round(low + width, 2), 0.0, round(top, 2), rooms)


def _outer_stretches(index: int, cells: list[Cell]) -> list[tuple[str, float, int, int]]:
    """The stretches of a cell's walls that touch no other cell: (axis, coordinate of the inner side, low, high)."""
    x0, z0, x1, z1 = cells[index]
    half = WALL / 2
    stretches = []
    for axis, wall, inside, low, high, facing in (
        ("z", x0, x0 / 100 + half, z0, z1, 2),
        ("z", x1, x1 / 100 - half, z0, z1, 0),
        ("x", z0, z0 / 100 + half, x0, x1, 3),
        ("x", z1, z1 / 100 - half, x0, x1, 1),
    ):
        along = (1, 3) if axis == "z" else (0, 2)
        spans = sorted((cell[along[0]], cell[along[1]]) for cell in cells if cell[facing] == wall)
        start = low
        for first, last in [*((max(a, low), min(b, high)) for a, b in spans if a < high and b > low), (high, high)]:
            if first > start:
                stretches.append((axis, inside, start, first))
            start = max(start, last)
    return stretches


def _windows(cells: list[Cell], rooms: tuple[Room, ...], draws: Draws) -> list[Opening]:
    """Draw windows in most outer walls, independently for each stretch of about five metres."""
    windows = []
    for index, room in enumerate(rooms):
        small = room.kind in PRIVATE
        for axis, wall, low, high in _outer_stretches(index, cells):
            count = max(round((high - low) / 500), 1)
            for number in range(count):
                if draws.chance(0.3 if small else 0.7):
                    # 0.15 m away from the ends, beyond which the wall belongs to other rooms.
                    first = round((low + (high - low) * number / count) / 100 + 0.15, 2)
                    last = round((low + (high - low) * (number + 1) / count) / 100 - 0.15, 2)
                    windows += windows_in_wall(index, small, axis, wall, first, last, draws)
    return windows


def _entrance(cells: list[Cell], kinds: list[str]) -> int:
    """The room with the front door: the first corridor with an outer wall, else hall, living room, or any room."""
    order = {"corridor": 0, "hall": 1, "living room": 2}
    outer = [index for index in range(len(cells)) if _outer_stretches(index, cells)]
    return min(outer, key=lambda index: (order.get(kinds[index], 3), index))
