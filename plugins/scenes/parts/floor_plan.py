"""Floor plans: rectangular rooms with doorways and windows."""

from dataclasses import dataclass

from deux_plugins.scenes.parts.draws import Draws

WALL = 0.1
"""Thickness of the walls, metres."""

CORNER_MARGIN = 0.2
"""Least distance of a doorway from the corner of a room in metres, for the door frame."""


@dataclass(frozen=True)
class Room:
    """The inside of one room, metres; `height` is the height of the ceiling."""

    kind: str
    x0: float
    z0: float
    x1: float
    z1: float
    height: float

    @property
    def area(self) -> float:
        """Square metres."""
        return (self.x1 - self.x0) * (self.z1 - self.z0)

    @property
    def centre(self) -> tuple[float, float]:
        """(x, z) of the centre."""
        return (self.x0 + self.x1) / 2, (self.z0 + self.z1) / 2

    @property
    def rectangle(self) -> tuple[float, float, float, float]:
        """(x0, z0, x1, z1)."""
        return self.x0, self.z0, self.x1, self.z1


@dataclass(frozen=True)
class Opening:
    """A doorway or a window, in a wall that runs along x or z.

    Args:
        axis: "x" if the wall runs along x, "z" if along z.
        wall: coordinate of the wall's middle on the other axis; for a window, of the inner side of the wall.
        low: begin along the wall.
        high: end along the wall.
        bottom: height of its sill, 0 for a doorway.
        top: height of its lintel.
        rooms: the rooms that it connects, the one with the smaller coordinate first; a window has one.
    """

    axis: str
    wall: float
    low: float
    high: float
    bottom: float
    top: float
    rooms: tuple[int, ...]


@dataclass(frozen=True)
class FloorPlan:
    """Rooms with their doorways and windows; `entrance` is the index of the room with the front door."""

    rooms: tuple[Room, ...]
    doors: tuple[Opening, ...]
    windows: tuple[Opening, ...]
    entrance: int


Cell = tuple[int, int, int, int]
"""x0, z0, x1, z1 of a room, bounded by the middle lines of its walls, in centimetres (integers are exact)."""


def cell_room(kind: str, cell: Cell, height: float) -> Room:
    """The room inside a cell's walls."""
    half = WALL / 2
    x0, z0, x1, z1 = cell
    return Room(kind, x0 / 100 + half, z0 / 100 + half, x1 / 100 - half, z1 / 100 - half, height)


def shared_wall(a: Cell, b: Cell) -> tuple[str, int, int, int, bool] | None:
    """(axis, coordinate, low, high, whether b comes first) of the wall between two cells, if a door fits into it."""
    for axis, (near, far, low, high) in (("z", (0, 2, 1, 3)), ("x", (1, 3, 0, 2))):
        for first, second, swapped in ((a, b, False), (b, a, True)):
            start, end = max(a[low], b[low]), min(a[high], b[high])
            if first[far] == second[near] and end - start >= 90 + 2 * (round(CORNER_MARGIN * 100) + 5):
                return axis, first[far], start, end, swapped
    return None


def windows_in_wall(
    index: int, small: bool, axis: str, wall: float, low: float, high: float, draws: Draws
) -> list[Opening]:
    """Draw one window, or two evenly spaced windows in a long wall.

    Args:
        index: index of the room.
        small: whether the windows are small and high, as in bathrooms.
        axis: see `Opening`.
        wall: see `Opening`.
        low: begin of the wall along its axis, metres.
        high: end of the wall along its axis, metres.
        draws: the random numbers.
    """
    width = draws.choice((0.6, 0.7)) if small else draws.choice((0.9, 1.1, 1.3, 1.6))
    bottom, top = (1.4, 2.0) if small else (draws.choice((0.85, 0.95, 1.05)), draws.choice((2.05, 2.15, 2.25)))
    count = 2 if high - low > 2.5 * width + 0.6 and not small and draws.chance(0.5) else 1
    if high - low < width + 0.5:
        return []
    windows = []
    for number in range(count):
        centre = low + (high - low) * (number + draws.uniform(0.45, 0.55)) / count
        start = round(min(max(centre - width / 2, low + 0.2), high - 0.2 - width), 2)
        windows.append(Opening(axis, wall, start, round(start + width, 2), bottom, top, (index,)))
    return windows
