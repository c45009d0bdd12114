"""Placement of furniture in a room: without overlaps, with free doorways and windows, and all doors connected."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.floor_plan import WALL, FloorPlan, Room
from deux_plugins.scenes.parts.mesh_builder import EAST, SOUTH, MeshBuilder, Placement
from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.walls import Side, sides

GAP = 0.025
"""Distance of furniture from the wall in metres, more than the depth of skirting boards and door frames."""

WALK_CELL = 0.1
WALK_RADIUS = 0.32
"""Cell of the walking grid, and radius of a disc that must fit through between all doors of a room, metres."""

HEAD_HEIGHT = 1.6
"""Height in metres above which things are no obstacles for a robot."""

LEAST_CONNECTED = 0.8
"""Least fraction of a room's free cells that are connected with its doors."""


@dataclass(frozen=True)
class Block:
    """An axis-aligned box in the world, metres."""

    x0: float
    y0: float
    z0: float
    x1: float
    y1: float
    z1: float

    def overlaps(self, other: "Block") -> bool:
        """Whether the interiors of the boxes overlap."""
        return (
            self.x0 < other.x1
            and other.x0 < self.x1
            and self.z0 < other.z1
            and other.z0 < self.z1
            and self.y0 < other.y1
            and other.y0 < self.y1
        )


def block(placement: Placement, width: float, z0: float, z1: float, height: float) -> Block:
    """The bounding box of the part of a placed model between two depths."""
    corners = [placement.beside(right, out) for right in (-width / 2, width / 2) for out in (z0, z1)]
    x, z = [corner.x for corner in corners], [corner.z for corner in corners]
    return Block(min(x), placement.y, min(z), max(x), placement.y + height, max(z))


class RoomSpace:
    """The free and the occupied space of one room while it is furnished.

    Args:
        plan: the floor plan.
        index: index of the room.
        builder: the mesh builder to which models are added.
        draws: the random numbers.
    """

    def __init__(self, plan: FloorPlan, index: int, builder: MeshBuilder, draws: Draws) -> None:
        self.room: Room = plan.rooms[index]
        self.sides = sides(self.room)
        self.outer_sides = [side for side in self.sides if not any(_touches(side, other) for other in plan.rooms)]
        self.entrance = index == plan.entrance
        self.windows: list[tuple[Side, float, float, float, float]] = []
        self._builder = builder
        self._draws = draws
        self._solids: list[Block] = []
        self._rugs: list[Block] = []
        self._reserved: list[Block] = []
        self._panes: list[Block] = []
        room, inset = self.room, 0.25
        self._x = np.arange(room.x0 + inset, room.x1 - inset + 1e-9, WALK_CELL)
        self._z = np.arange(room.z0 + inset, room.z1 - inset + 1e-9, WALK_CELL)
        self._blocked = np.zeros((len(self._z), len(self._x)), dtype=bool)
        self._door_cells: list[tuple[int, int]] = []
        for opening in (*plan.doors, *plan.windows):
            if index not in opening.rooms:
                continue
            side = next(side for side in self.sides if side.holds(opening))
            low, high = side.span(opening)
            middle, width = side.place((low + high) / 2), high - low
            if opening.bottom == 0.0:
                self._reserved.append(block(middle, width + 0.16, 0.0, 0.75, opening.top + 0.1))
                centre = middle.beside(0.0, 0.35)
                self._door_cells.append(
                    (int(np.argmin(np.abs(self._z - centre.z))), int(np.argmin(np.abs(self._x - centre.x))))
                )
            else:
                pane = block(middle, width + 0.1, 0.0, 0.25, opening.top)
                self._panes.append(Block(pane.x0, opening.bottom - 0.04, pane.z0, pane.x1, pane.y1, pane.z1))
                self.windows.append((side, low, high, opening.bottom, opening.top))

    def place(
        self,
        model: Model,
        placement: Placement,
        *,
        ignoring: Placement | None = None,
        at_window: bool = False,
    ) -> Placement | None:
        """Place a model if it fits.

        Args:
            model: the model.
            placement: its placement.
            ignoring: placement of a table under which the model may be pushed.
            at_window: whether it may cover a window's edge.

        Returns:
            The placement, or None if the model does not fit.
        """
        body = block(placement, model.width, 0.0, model.depth, model.height)
        front = block(placement, model.width, model.depth, model.depth + model.front, min(model.height, 1.0))
        others = [solid for solid in self._solids if ignoring is None or not _is_placed_at(solid, ignoring)]
        obstacles = [*others, *self._reserved, *([] if at_window else self._panes)]
        if not self._inside(body) or any(body.overlaps(other) for other in obstacles):
            return None
        if model.front and (not self._inside(front, 0.0) or any(front.overlaps(solid) for solid in self._solids)):
            return None
        blocked = self._blocked | self._shadow(body)
        if body.y0 < HEAD_HEIGHT and not self._walkable(blocked):
            return None
        self._blocked = blocked
        self._solids.append(body)
        if model.front:
            self._reserved.append(front)
        self._builder.add(model, placement)
        return placement

    def against_wall(
        self,
        model: Model,
        *,
        up: float = 0.0,
        tries: int = 12,
        gap: float = GAP,
        at: Sequence[Side] | None = None,
    ) -> Placement | None:
        """Place a model at a random position along a wall, often in a corner.

        Args:
            model: the model.
            up: height above the floor, metres.
            tries: number of random positions to try.
            gap: distance from the wall, metres.
            at: the walls to choose from; None for all.

        Returns:
            The placement, or None if the model does not fit.
        """
        for _ in range(tries):
            side = self._draws.choice(at or self.sides)
            room = side.length / 2 - model.width / 2 - 2 * GAP
            if room <= 0.0:
                continue
            ends = (-room, room) if up == 0.0 else ()
            right = self._draws.choice((*ends, self._draws.uniform(-room, room), self._draws.uniform(-room, room)))
            placed = self.place(model, side.place(right, gap, up))
            if placed is not None:
                return placed
        return None

    def in_the_open(self, model: Model, tries: int = 12) -> Placement | None:
        """Place a model near the middle of the room; None if it does not fit."""
        room, turns = self.room, [side.turn for side in self.sides]
        for _ in range(tries):
            x = room.x0 + (room.x1 - room.x0) * self._draws.uniform(0.3, 0.7)
            z = room.z0 + (room.z1 - room.z0) * self._draws.uniform(0.3, 0.7)
            middle = Placement(round(x, 3), round(z, 3), self._draws.choice(turns))
            placed = self.place(model, middle.beside(0.0, -model.depth / 2))
            if placed is not None:
                return placed
        return None

    def lay(self, model: Model, placement: Placement) -> Placement | None:
        """Place a rug, which may overlap with furniture but not with other rugs; None if it does not fit."""
        body = block(placement, model.width, 0.0, model.depth, model.height)
        if not self._inside(body, 0.03) or any(body.overlaps(other) for other in self._rugs):
            return None
        self._rugs.append(body)
        self._builder.add(model, placement)
        return placement

    def hang_free(self, model: Model, placement: Placement) -> None:
        """Add a model that hangs above everything else, without checks."""
        self._builder.add(model, placement)

    def _inside(self, body: Block, margin: float = 0.001) -> bool:
        room = self.room
        return (
            body.x0 >= room.x0 + margin
            and body.x1 <= room.x1 - margin
            and body.z0 >= room.z0 + margin
            and body.z1 <= room.z1 - margin
            and body.y1 <= self.room.height - 0.02
        )

    def _shadow(self, body: Block) -> np.ndarray:
        """The cells of the walking grid that a box blocks for a disc of the walking radius."""
        if body.y0 >= HEAD_HEIGHT:
            return np.zeros_like(self._blocked)
        x = (self._x > body.x0 - WALK_RADIUS) & (self._x < body.x1 + WALK_RADIUS)
        z = (self._z > body.z0 - WALK_RADIUS) & (self._z < body.z1 + WALK_RADIUS)
        return z[:, None] & x[None, :]

    def _walkable(self, blocked: np.ndarray) -> bool:
        """Whether all doors of the room are connected by free cells, and most free cells are connected with them."""
        regions, _ = ndimage.label(~blocked)
        joined = {int(regions[cell]) for cell in self._door_cells}
        if len(joined) != 1 or 0 in joined:
            return False
        return int((regions == joined.pop()).sum()) >= LEAST_CONNECTED * int((~blocked).sum())


def _is_placed_at(solid: Block, placement: Placement) -> bool:
    """Whether a box belongs to the model at a placement: it contains the point just inside the model's back."""
    inside = placement.beside(0.0, 0.05)
    return solid.x0 < inside.x < solid.x1 and solid.z0 < inside.z < solid.z1


def _touches(side: Side, room: Room) -> bool:
    """Whether the room is on the other side of the wall."""
    along_x = side.axis == "x"
    low, high = (room.x0, room.x1) if along_x else (room.z0, room.z1)
    near, far = (room.z0, room.z1) if along_x else (room.x0, room.x1)
    behind = far if side.turn in (SOUTH, EAST) else near
    return low < side.high and side.low < high and abs(abs(behind - side.wall) - WALL) < WALL / 2
