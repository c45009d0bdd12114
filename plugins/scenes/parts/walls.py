"""The building: floors, walls, ceilings, doorways and windows."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deux_plugins.scenes.parts.floor_plan import WALL, FloorPlan, Opening, Room
from deux_plugins.scenes.parts.mesh_builder import EAST, NORTH, SOUTH, WEST, MeshBuilder, Placement
from deux_plugins.scenes.parts.shapes import Model, Quads, rectangle
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.surfaces import Surface

TILE = 0.75
"""Greatest edge of the quadrilaterals of floors, walls and ceilings in metres, the resolution of baked lighting."""

NICHE = 0.14
"""Depth of the window niches, metres."""

SKIRTING_DEPTH, SKIRTING_HEIGHT = 0.012, 0.08
CASING_DEPTH, CASING_WIDTH = 0.016, 0.08


@dataclass(frozen=True)
class Side:
    """One wall of a room as seen from inside.

    The origin of its frame is at the middle of the wall, with x to the right, y up and z into the room.

    Args:
        axis: "x" if the wall runs along x, "z" if along z.
        wall: the wall's coordinate on the other axis, metres.
        low: begin along its axis.
        high: end along its axis.
        turn: (cosine, sine) of the rotation of the frame.
    """

    axis: str
    wall: float
    low: float
    high: float
    turn: tuple[float, float]

    @property
    def length(self) -> float:
        """Length of the wall, metres."""
        return self.high - self.low

    def place(self, right: float, out: float = 0.0, up: float = 0.0) -> Placement:
        """A model's placement with its back to the wall, `right` of the middle and `out` from the wall, metres."""
        cosine, sine = self.turn
        middle = (self.low + self.high) / 2 + right * (cosine - sine)
        wall = self.wall + out * (cosine + sine)
        return Placement(middle, wall, self.turn, up) if self.axis == "x" else Placement(wall, middle, self.turn, up)

    def span(self, opening: Opening) -> tuple[float, float]:
        """Begin and end of an opening in this wall, as distances to the right of the middle."""
        cosine, sine = self.turn
        middle = (self.low + self.high) / 2
        ends = sorted(((opening.low - middle) * (cosine - sine), (opening.high - middle) * (cosine - sine)))
        return ends[0], ends[1]

    def holds(self, opening: Opening) -> bool:
        """Whether the opening is in this wall, given that it is in one of the room's walls."""
        return opening.axis == self.axis and abs(opening.wall - self.wall) < WALL and opening.low < self.high


def sides(room: Room) -> tuple[Side, Side, Side, Side]:
    """The four walls of a room."""
    return (
        Side("x", room.z0, room.x0, room.x1, SOUTH),
        Side("x", room.z1, room.x0, room.x1, NORTH),
        Side("z", room.x0, room.z0, room.z1, EAST),
        Side("z", room.x1, room.z0, room.z1, WEST),
    )


@dataclass(frozen=True)
class Finish:
    """The materials of one room.

    Args:
        floor: the floor, also in doorways in which the room is the first.
        ceiling: the ceiling.
        upper: the walls above `border`.
        lower: the walls below `border`.
        border: height of the border between the two, metres; 0 for none.
        accent: the upper part of the first wall.
    """

    floor: Surface
    ceiling: Surface
    upper: Surface
    lower: Surface
    border: float
    accent: Surface


def build_room(plan: FloorPlan, index: int, finish: Finish, style: Style, builder: MeshBuilder) -> None:
    """Add floor, walls, ceiling, doorways and windows of one room."""
    room = plan.rooms[index]
    openings = [opening for opening in (*plan.doors, *plan.windows) if index in opening.rooms]
    builder.extend(_level(room, finish.floor, "floor", 0.0))
    builder.extend(_level(room, finish.ceiling, "ceiling", room.height))
    for number, side in enumerate(sides(room)):
        here = [opening for opening in openings if side.holds(opening)]
        upper = finish.accent if number == 0 else finish.upper
        _wall(side, room.height, here, (finish.lower, upper, finish.border), builder)
        _skirting(side, [side.span(opening) for opening in here if opening.bottom == 0.0], style.trim, builder)
        for opening in here:
            _frame(side, opening, index == opening.rooms[0], finish.floor, style, builder)


def _lines(fixed: list[float]) -> np.ndarray:
    """The fixed coordinates, and further ones between them such that all distances are at most `TILE`."""
    marks = sorted({round(mark, 3) for mark in fixed})
    lines = [
        np.linspace(start, end, int(np.ceil(round((end - start) / TILE, 3))) + 1)[:-1]
        for start, end in itertools.pairwise(marks)
    ]
    return np.append(np.concatenate(lines), marks[-1])


def _sheet(
    u: np.ndarray,
    v: np.ndarray,
    keep: Callable[[np.ndarray, np.ndarray], np.ndarray],
    surface: Surface,
    label: str,
) -> Quads:
    """Quadrilaterals of the grid of lines u and v in the plane (u, v, 0) whose centres satisfy `keep`."""
    low_u, low_v = np.meshgrid(u[:-1], v[:-1], indexing="ij")
    high_u, high_v = np.meshgrid(u[1:], v[1:], indexing="ij")
    kept = keep((low_u + high_u) / 2, (low_v + high_v) / 2)
    pairs = ((low_u, low_v), (high_u, low_v), (high_u, high_v), (low_u, high_v))
    uv = np.stack([np.stack([a[kept], b[kept]], axis=-1) for a, b in pairs], axis=1)
    corners = np.concatenate([uv, np.zeros((*uv.shape[:2], 1))], axis=-1)
    return Quads(corners, uv, surface, label)


def _level(room: Room, surface: Surface, label: str, height: float) -> list[Quads]:
    """A floor (at height 0) or a ceiling over the whole room."""
    facing = 1.0 if height == 0.0 else -1.0
    z_low, z_high = sorted((-facing * room.z0, -facing * room.z1))
    plane = _sheet(
        _lines([room.x0, room.x1]),
        _lines([z_low, z_high]),
        lambda u, v: np.ones(u.shape, bool),
        surface,
        label,
    )
    x, z = plane.corners[..., 0], -facing * plane.corners[..., 1]
    return [Quads(np.stack([x, np.full(x.shape, height), z], axis=-1), plane.uv, surface, label)]


def _wall(
    side: Side,
    height: float,
    openings: list[Opening],
    covering: tuple[Surface, Surface, float],
    builder: MeshBuilder,
) -> None:
    """Add one wall with its openings cut out; `covering` is (lower material, upper material, border)."""
    lower, upper, border = covering
    holes = [(*side.span(opening), opening.bottom, opening.top) for opening in openings]
    u = _lines([-side.length / 2, side.length / 2, *(edge for hole in holes for edge in hole[:2])])
    v = _lines([0.0, height, border, *(edge for hole in holes for edge in hole[2:])])
    solid = _outside(holes)
    place = side.place(0.0)
    shift = np.array([side.low + side.wall, 0.0])
    for surface, kept in (
        (lower, lambda a, b: solid(a, b) & (b < border)),
        (upper, lambda a, b: solid(a, b) & (b > border)),
    ):
        sheet = _sheet(u, v, kept, surface, "wall")
        if len(sheet.corners):
            builder.extend([Quads(place.apply(sheet.corners), sheet.uv + shift, surface, "wall")])


def _outside(
    holes: list[tuple[float, float, float, float]],
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    def outside(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        inside = [(u > left) & (u < right) & (v > bottom) & (v < top) for left, right, bottom, top in holes]
        return ~np.logical_or.reduce(inside) if inside else np.ones(u.shape, dtype=bool)

    return outside


def _skirting(side: Side, doors: list[tuple[float, float]], surface: Surface, builder: MeshBuilder) -> None:
    """Add a skirting board along the wall between the door frames."""
    model = Model("wall", side.length, SKIRTING_DEPTH, SKIRTING_HEIGHT)
    # At a corner only one of the two boards extends to the end.
    end = side.length / 2 - (SKIRTING_DEPTH if side.axis == "z" else 0.0)
    edges = [
        -end,
        *(edge for low, high in sorted(doors) for edge in (low - CASING_WIDTH, high + CASING_WIDTH)),
        end,
    ]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        if high - low > 0.02:
            model.box((low, 0.0, 0.0), (high, SKIRTING_HEIGHT, SKIRTING_DEPTH), surface)
    builder.add(model, side.place(0.0))


def _frame(side: Side, opening: Opening, first: bool, floor: Surface, style: Style, builder: MeshBuilder) -> None:
    low, high = side.span(opening)
    if opening.bottom > 0.0:
        builder.add(_window(high - low, opening, style), side.place((low + high) / 2))
        return
    builder.add(_casing(high - low, opening.top, style.trim), side.place((low + high) / 2))
    if first:
        builder.add(_reveal(high - low, opening.top, style.trim, floor), side.place((low + high) / 2))


def _casing(width: float, top: float, surface: Surface) -> Model:
    """The frame around a doorway on one side of the wall."""
    half, outer = width / 2, width / 2 + CASING_WIDTH
    model = Model("door frame", 2 * outer, CASING_DEPTH, top + CASING_WIDTH)
    model.box((-outer, 0.0, 0.0), (-half, top, CASING_DEPTH), surface)
    model.box((half, 0.0, 0.0), (outer, top, CASING_DEPTH), surface)
    model.box((-outer, top, 0.0), (outer, top + CASING_WIDTH, CASING_DEPTH), surface)
    return model


def _reveal(width: float, top: float, surface: Surface, floor: Surface) -> Model:
    """The reveal of a doorway, and the floor in it."""
    half = width / 2
    model = Model("door frame", width, WALL, top)
    model.parts = [
        rectangle((-half, 0.0, 0.0), (0, 0, -WALL), (0, top, 0), surface, "door frame"),
        rectangle((half, 0.0, -WALL), (0, 0, WALL), (0, top, 0), surface, "door frame"),
        rectangle((-half, top, -WALL), (width, 0, 0), (0, 0, WALL), surface, "door frame"),
        rectangle((-half, 0.0, 0.0), (width, 0, 0), (0, 0, -WALL), floor, "floor"),
    ]
    return model


def _window(width: float, opening: Opening, style: Style) -> Model:
    """A window niche with a sill, a frame, bars and a view painted on the pane."""
    half, bottom, top, trim = width / 2, opening.bottom, opening.top, style.trim
    height, bar = top - bottom, 0.05
    model = Model("window", width, NICHE, top)
    view = style.pick("landscape", "city")
    model.parts = [
        rectangle((-half, bottom, 0.0), (0, 0, -NICHE), (0, height, 0), trim, "window"),
        rectangle((half, bottom, -NICHE), (0, 0, NICHE), (0, height, 0), trim, "window"),
        rectangle((-half, top, -NICHE), (width, 0, 0), (0, 0, NICHE), trim, "window"),
        rectangle((-half, bottom, 0.0), (width, 0, 0), (0, 0, -NICHE), trim, "window"),
        rectangle((-half, bottom, -NICHE), (width, 0, 0), (0, height, 0), view, "window"),
    ]
    back, front = -NICHE, -NICHE + 0.04
    for left in (-half, -bar / 2, half - bar) if width > 0.8 else (-half, half - bar):
        model.box((left, bottom, back), (left + bar, top, front), trim)
    for foot in (bottom, top - bar):
        model.box((-half, foot, back), (half, foot + bar, front - 0.005), trim)
    model.box((-half - 0.05, bottom - 0.03, 0.0), (half + 0.05, bottom - 0.002, 0.022), trim)
    return model
