"""Floor plans of flats: a rectangle split into rooms, with doorways and windows."""

from dataclasses import replace
from itertools import combinations, pairwise

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

DOOR_HEIGHT = 2.05
LEAST_ROOMS, MOST_ROOMS = 4, 7
ROOM_ORDER = ("living room", "bedroom", "kitchen", "bedroom", "study", "study", "bedroom")
"""Uses of the rooms from the largest to the second smallest; the smallest is the bathroom."""


def make_floor_plan(draws: Draws) -> FloorPlan:
    """Draw a plan of 35 to 90 square metres with 4 to 7 rooms, all connected by doorways."""
    while True:
        cells, hallway = _cells(draws)
        if len(cells) < LEAST_ROOMS:
            continue
        kinds = _kinds(cells, hallway, draws)
        doors = _doors(cells, kinds, draws)
        if doors is not None:
            break
    rooms = tuple(cell_room(kind, cell, 0.0) for kind, cell in zip(kinds, cells, strict=True))
    windows = _windows(cells, rooms, draws)
    height = draws.choice((2.5, 2.55, 2.6, 2.7))
    entrance = kinds.index("hallway" if "hallway" in kinds else "living room")
    rooms = tuple(replace(room, height=height) for room in rooms)
    return FloorPlan(rooms, tuple(doors), tuple(windows), entrance)


def _cells(draws: Draws) -> tuple[list[Cell], int | None]:
    """Split a rectangle, either freely or on both sides of a hallway; returns the cells and the hallway's index."""
    while True:
        width, depth = draws.integer(60, 115) * 10, draws.integer(56, 100) * 10
        if 37_0000 <= width * depth <= 88_0000:
            break
    if depth >= 680 and width >= 700 and draws.chance(0.65):
        return _cells_along_hallway(width, depth, draws)
    count = min(draws.integer(LEAST_ROOMS, MOST_ROOMS), width * depth // 8_0000)
    cells: list[Cell] = [(0, 0, width, depth)]
    while len(cells) < count:
        cell = max(cells, key=lambda c: (c[2] - c[0]) * (c[3] - c[1]) * (1 + draws.integer(0, 40) / 100))
        halves = _split(cell, draws)
        if halves is None:
            break
        cells.remove(cell)
        cells += halves
    return cells, None


def _cells_along_hallway(width: int, depth: int, draws: Draws) -> tuple[list[Cell], int]:
    hallway = draws.integer(13, 17) * 10
    near = round((depth - hallway) * draws.uniform(0.42, 0.58) / 10) * 10
    cells: list[Cell] = [(0, near, width, near + hallway)]
    for z0, z1 in ((0, near), (near + hallway, depth)):
        count = draws.integer(2, 3) if width >= 800 else 2
        weights = [draws.integer(80, 130) for _ in range(count)]
        edges = [round(width * sum(weights[:index]) / sum(weights) / 10) * 10 for index in range(count)] + [width]
        cells += [(x0, z0, x1, z1) for x0, x1 in pairwise(edges)]
    return cells, 0


def _split(cell: Cell, draws: Draws, least: int = 210) -> list[Cell] | None:
    """Cut a cell across its longer side, or None if it is too short for two rooms."""
    x0, z0, x1, z1 = cell
    across_x = (x1 - x0) * draws.uniform(0.85, 1.18) >= (z1 - z0)
    length = (x1 - x0) if across_x else (z1 - z0)
    if length < 2 * least:
        return None
    cut = min(max(round(length * draws.uniform(0.36, 0.64) / 10) * 10, least), length - least)
    if across_x:
        return [(x0, z0, x0 + cut, z1), (x0 + cut, z0, x1, z1)]
    return [(x0, z0, x1, z0 + cut), (x0, z0 + cut, x1, z1)]


def _kinds(cells: list[Cell], hallway: int | None, draws: Draws) -> list[str]:
    kinds = ["hallway"] * len(cells)
    by_area = sorted(
        (index for index in range(len(cells)) if index != hallway),
        key=lambda i: (cells[i][0] - cells[i][2]) * (cells[i][3] - cells[i][1]),
    )
    order = list(ROOM_ORDER[: len(by_area) - 1])
    # The living room is the largest; the bedroom or the kitchen comes next.
    if draws.chance(0.4):
        order[1], order[2] = order[2], order[1]
    for index, kind in zip(by_area, [*order, "bathroom"], strict=True):
        kinds[index] = kind
    return kinds


def _doors(cells: list[Cell], kinds: list[str], draws: Draws) -> list[Opening] | None:
    """Draw doorways along a random spanning tree, and some more; None if the rooms cannot all be connected."""
    shared = []
    for a, b in combinations(range(len(cells)), 2):
        wall = shared_wall(cells[a], cells[b])
        if wall is not None:
            # Prefer doors to hallways and living rooms, and avoid passages through bathrooms and bedrooms.
            private = sum(kinds[index] in ("bathroom", "bedroom") for index in (a, b))
            through = any(kinds[index] in ("hallway", "living room") for index in (a, b))
            shared.append((draws.uniform(0.0, 1.0) + 0.8 * private - 1.5 * through, a, b, wall))
    group = list(range(len(cells)))
    doors: list[Opening] = []
    for _, a, b, wall in sorted(shared, key=lambda item: item[0]):
        joins = group[a] != group[b]
        group = [group[a] if member == group[b] else member for member in group]
        loop_chance = 0.0 if "bathroom" in (kinds[a], kinds[b]) else 0.6
        if joins or draws.chance(loop_chance):
            doors.append(_doorway(a, b, wall, kinds, draws))
    return doors if len(set(group)) == 1 else None


def _doorway(a: int, b: int, wall: tuple[str, int, int, int, bool], kinds: list[str], draws: Draws) -> Opening:
    axis, coordinate, start, end, swapped = wall
    margin = CORNER_MARGIN + WALL / 2
    room = (end - start) / 100 - 2 * margin
    sociable = {kinds[a], kinds[b]} <= {"living room", "kitchen", "hallway", "study"}
    width = draws.choice((1.4, 1.8, 2.0)) if sociable and draws.chance(0.4) else draws.choice((0.9, 0.95, 1.0))
    width = min(width, max(room, 0.9))
    # Doors near a corner leave long walls for furniture.
    place = draws.choice((0.0, 0.0, 1.0, 1.0, draws.uniform(0.0, 1.0)))
    low = round(start / 100 + margin + (room - width) * place, 2)
    return Opening(axis, coordinate / 100, low, round(low + width, 2), 0.0, DOOR_HEIGHT, (b, a) if swapped else (a, b))


def _windows(cells: list[Cell], rooms: tuple[Room, ...], draws: Draws) -> list[Opening]:
    width, depth = max(cell[2] for cell in cells), max(cell[3] for cell in cells)
    windows = []
    for index, (cell, room) in enumerate(zip(cells, rooms, strict=True)):
        sides = [
            ("z", room.x0, room.z0, room.z1, cell[0] == 0),
            ("z", room.x1, room.z0, room.z1, cell[2] == width),
            ("x", room.z0, room.x0, room.x1, cell[1] == 0),
            ("x", room.z1, room.x0, room.x1, cell[3] == depth),
        ]
        for axis, wall, low, high, outer in sides:
            if outer and draws.chance(0.85):
                windows += windows_in_wall(index, room.kind == "bathroom", axis, wall, low, high, draws)
    return windows
