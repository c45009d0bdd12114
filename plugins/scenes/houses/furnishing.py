"""The furniture of each kind of room in a house."""

from collections.abc import Callable

from deux_plugins.scenes.houses.character import Clutter
from deux_plugins.scenes.houses.furniture import bench, pillar, rack, stack
from deux_plugins.scenes.parts import furniture_decor as decor
from deux_plugins.scenes.parts import furniture_seating as seating
from deux_plugins.scenes.parts import furniture_storage as storage
from deux_plugins.scenes.parts import furniture_tables as tables
from deux_plugins.scenes.parts.furnishing import ROOMS
from deux_plugins.scenes.parts.furniture_groups import desk_group, dining_group, dress_windows, hang_lamp, lay_rug
from deux_plugins.scenes.parts.mesh_builder import EAST, NORTH, SOUTH, Placement
from deux_plugins.scenes.parts.placement import RoomSpace
from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style

LAMP_DISTANCE = 5.0
"""Distance between the lamps of a long room, metres."""

AISLE = 1.7
"""Distance between the backs of two rows of shelves, metres."""


def furnish_house_room(space: RoomSpace, style: Style, clutter: Clutter) -> None:
    """Furnish a room: the furniture of its kind, and further pieces by its clutter."""
    if space.entrance and space.outer_sides:
        space.against_wall(decor.front_door(style), tries=40, gap=0.002, at=space.outer_sides)
    if space.room.kind == "hall":
        _set_pillars(space, style)
    if clutter == "bare":
        if style.draws.chance(0.6):
            space.against_wall(style.draws.choice((bench, seating.chair, decor.plant, stack))(style))
    else:
        HOUSE_ROOMS[space.room.kind](space, style)
    dress_windows(space, style)
    if clutter == "usual":
        _add_more(space, style, int(space.room.area / 14.0))
        _hang_pictures(space, style, 2 + int(space.room.area / 12.0))
    elif clutter == "dense":
        _add_more(space, style, 2 + int(space.room.area / 6.0))
        _hang_pictures(space, style, 4 + int(space.room.area / 5.0))
    _hang_lamps(space, style)


def _corridor(space: RoomSpace, style: Style) -> None:
    for piece in (storage.shoe_cabinet, bench, decor.plant):
        if style.draws.chance(0.6):
            space.against_wall(piece(style))
    if style.draws.chance(0.4):
        space.against_wall(decor.coat_rack(style), up=style.draws.uniform(0.75, 0.85), gap=0.002)


def _hall(space: RoomSpace, style: Style) -> None:
    for _ in range(1 + int(space.room.area / 20.0)):
        group = style.draws.choice((dining_group, _seats, _seats))
        group(space, style)
    for _ in range(style.draws.integer(1, 4)):
        space.against_wall(style.draws.choice((bench, decor.plant, decor.floor_lamp, storage.dresser))(style))


def _seats(space: RoomSpace, style: Style) -> None:
    """A sofa in the open or at a wall, with a low table on a rug in front of it."""
    couch = seating.sofa(style)
    seat = space.in_the_open(couch, tries=10) or space.against_wall(couch, tries=20)
    if seat is not None:
        lay_rug(space, style, seat.beside(0.0, couch.depth - 0.15))
        space.place(tables.coffee_table(style), seat.beside(0.0, couch.depth + 0.37))


def _dining_room(space: RoomSpace, style: Style) -> None:
    for _ in range(1 + int(space.room.area / 16.0)):
        dining_group(space, style)
    for piece in (storage.dresser, storage.dresser, decor.plant):
        space.against_wall(piece(style))


def _library(space: RoomSpace, style: Style) -> None:
    _rows(space, style, storage.bookshelf)
    for _ in range(int((space.room.x1 - space.room.x0 + space.room.z1 - space.room.z0) * 0.9)):
        space.against_wall(storage.bookshelf(style), tries=8)
    desk_group(space, style)
    space.against_wall(seating.armchair(style))


def _storeroom(space: RoomSpace, style: Style) -> None:
    _rows(space, style, rack)
    for _ in range(int((space.room.x1 - space.room.x0 + space.room.z1 - space.room.z0) * 0.7)):
        space.against_wall(rack(style), tries=8)
    for _ in range(style.draws.integer(2, 5)):
        space.against_wall(stack(style))


def _closet(space: RoomSpace, style: Style) -> None:
    space.against_wall(style.draws.choice((rack, storage.wardrobe, storage.bookshelf))(style), tries=30)
    for piece in (stack, storage.shoe_cabinet, rack):
        space.against_wall(piece(style), tries=20)
    space.against_wall(decor.coat_rack(style), up=style.draws.uniform(0.75, 0.85), gap=0.002)


def _workroom(space: RoomSpace, style: Style) -> None:
    for _ in range(2 + int(space.room.area / 9.0)):
        desk_group(space, style)
    for _ in range(style.draws.integer(1, 3)):
        space.against_wall(style.draws.choice((storage.bookshelf, rack, storage.dresser))(style))
    if space.room.area > 25.0:
        dining_group(space, style)


HOUSE_ROOMS: dict[str, Callable[[RoomSpace, Style], None]] = {
    **ROOMS,
    "corridor": _corridor,
    "hall": _hall,
    "dining room": _dining_room,
    "library": _library,
    "storeroom": _storeroom,
    "closet": _closet,
    "workroom": _workroom,
}
"""How each kind of room is furnished."""


def _rows(space: RoomSpace, style: Style, piece: Callable[[Style], Model]) -> None:
    """Add rows of shelves back to back in the middle of the room, if it is wide enough."""
    room = space.room
    along_x = room.x1 - room.x0 >= room.z1 - room.z0
    length, breadth = sorted((room.x1 - room.x0, room.z1 - room.z0), reverse=True)
    middle_x, middle_z = room.centre
    count = int((breadth - 1.2) / AISLE)
    for number in range(count):
        across = (number - (count - 1) / 2) * AISLE
        cursor = -length / 2 + 1.1
        while cursor < length / 2 - 1.1:
            models = [piece(style), piece(style)]
            width = max(model.width for model in models)
            if cursor + width > length / 2 - 1.1:
                break
            along = cursor + width / 2
            x, z = (middle_x + along, middle_z + across) if along_x else (middle_x + across, middle_z + along)
            row = Placement(round(x, 3), round(z, 3), SOUTH if along_x else EAST)
            for model, turn in zip(models, (SOUTH, NORTH), strict=True):
                space.place(model, row.beside(0.0, 0.01 * turn[0], turn))
            cursor += width + 0.02


def _set_pillars(space: RoomSpace, style: Style) -> None:
    """Add two or four pillars, away from the middle line with the lamps."""
    room = space.room
    if min(room.x1 - room.x0, room.z1 - room.z0) < 4.5 or not style.draws.chance(0.6):
        return
    model = pillar(style, room.height)
    width, depth = room.x1 - room.x0, room.z1 - room.z0
    for x in (0.28, 0.72):
        for z in (0.28, 0.72) if min(width, depth) > 5.5 else (0.28,):
            middle = Placement(round(room.x0 + width * x, 3), round(room.z0 + depth * z, 3))
            space.place(model, middle.beside(0.0, -model.depth / 2))


def _add_more(space: RoomSpace, style: Style, count: int) -> None:
    """Add pieces that any room may contain, along the walls."""
    pieces = (
        storage.bookshelf, storage.dresser, seating.armchair, seating.chair, seating.stool, decor.floor_lamp,
        decor.plant, stack, bench, storage.shoe_cabinet, rack,
    )  # fmt: skip
    for _ in range(count):
        space.against_wall(style.draws.choice(pieces)(style), tries=6)


def _hang_pictures(space: RoomSpace, style: Style, count: int) -> None:
    for _ in range(count):
        if style.draws.chance(0.15):
            space.against_wall(storage.wall_shelf(style), up=style.draws.uniform(1.3, 1.6), tries=6)
        else:
            space.against_wall(decor.picture(style), up=style.draws.uniform(1.15, 1.5), gap=0.002, tries=6)


def _hang_lamps(space: RoomSpace, style: Style) -> None:
    """Add lamps along the middle line of the room."""
    room = space.room
    width, depth = room.x1 - room.x0, room.z1 - room.z0
    count = max(round(max(width, depth) / LAMP_DISTANCE), 1)
    for number in range(count):
        share = (number + 0.5) / count
        x, z = (width * share, depth / 2) if width >= depth else (width / 2, depth * share)
        hang_lamp(space, style, Placement(round(room.x0 + x, 3), round(room.z0 + z, 3)))
