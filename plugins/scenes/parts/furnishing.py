"""The furniture of each kind of room in a flat, in the order of placement."""

from collections.abc import Callable

from deux_plugins.scenes.parts import furniture_bathroom as bathroom
from deux_plugins.scenes.parts import furniture_decor as decor
from deux_plugins.scenes.parts import furniture_kitchen as kitchen
from deux_plugins.scenes.parts import furniture_seating as seating
from deux_plugins.scenes.parts import furniture_storage as storage
from deux_plugins.scenes.parts import furniture_tables as tables
from deux_plugins.scenes.parts.furniture_groups import desk_group, dining_group, dress_windows, hang_lamp, lay_rug
from deux_plugins.scenes.parts.mesh_builder import Placement
from deux_plugins.scenes.parts.placement import GAP, RoomSpace
from deux_plugins.scenes.parts.style import Style


def furnish(space: RoomSpace, style: Style) -> None:
    """Furnish a room: the furniture of its kind, then curtains, radiators and other things that every room has."""
    if space.entrance and space.outer_sides:
        space.against_wall(decor.front_door(style), tries=40, gap=0.002, at=space.outer_sides)
    ROOMS[space.room.kind](space, style)
    dress_windows(space, style)
    if style.draws.chance(0.7):
        space.against_wall(decor.plant(style))
    if style.draws.chance(0.2):
        space.against_wall(storage.wall_shelf(style), up=style.draws.uniform(1.3, 1.6))
    count = 2 if space.room.kind in ("hallway", "bathroom", "kitchen") else style.draws.integer(3, 5)
    for _ in range(count):
        space.against_wall(decor.picture(style), up=style.draws.uniform(1.15, 1.5), gap=0.002)
    hang_lamp(space, style, Placement(*space.room.centre))


def _living_room(space: RoomSpace, style: Style) -> None:
    couch = seating.sofa(style)
    seat = space.against_wall(couch, tries=60)
    if seat is not None:
        lay_rug(space, style, seat.beside(0.0, couch.depth - 0.15))
        low_table = tables.coffee_table(style)
        space.place(low_table, seat.beside(style.draws.uniform(-0.1, 0.1), couch.depth + 0.37))
    space.against_wall(storage.television(style), tries=20)
    for piece in (storage.bookshelf, seating.armchair, storage.dresser, decor.floor_lamp):
        if style.draws.chance(0.8):
            space.against_wall(piece(style))
    if space.room.area > 14.0:
        dining_group(space, style)
        space.against_wall(storage.bookshelf(style))
    if style.draws.chance(0.5):
        space.against_wall(seating.armchair(style))


def _bedroom(space: RoomSpace, style: Style) -> None:
    for width in (style.draws.choice((1.4, 1.6, 1.8)), 0.95):
        sleeping = storage.bed(style, width)
        head = space.against_wall(sleeping, tries=50)
        if head is not None:
            break
    if head is not None:
        for side in (-1, 1):
            stand = storage.nightstand(style)
            space.place(stand, head.beside(side * (sleeping.width / 2 + stand.width / 2 + 0.03), 0.0))
        lay_rug(space, style, head.beside(style.draws.uniform(-0.5, 0.5), 1.0))
    space.against_wall(storage.wardrobe(style), tries=50)
    for piece in (storage.dresser, seating.armchair, storage.bookshelf, decor.floor_lamp):
        if style.draws.chance(0.55):
            space.against_wall(piece(style))
    if style.draws.chance(0.4):
        desk_group(space, style)


def _study(space: RoomSpace, style: Style) -> None:
    desk_group(space, style)
    for _ in range(style.draws.integer(1, 3)):
        space.against_wall(storage.bookshelf(style))
    for piece in (seating.armchair, storage.dresser, decor.floor_lamp, seating.stool):
        if style.draws.chance(0.6):
            space.against_wall(piece(style))
    lay_rug(space, style, Placement(*space.room.centre, style.draws.choice(space.sides).turn))


def _kitchen(space: RoomSpace, style: Style) -> None:
    front, top = style.front(), style.stone()
    row = [
        kitchen.refrigerator(style),
        kitchen.sink_unit(style, front, top),
        kitchen.counter(style, style.draws.choice((0.6, 0.9, 1.2)), front, top),
        kitchen.stove(style),
        kitchen.counter(style, style.draws.choice((0.5, 0.6, 0.9)), front, top),
    ]
    for side in sorted(space.sides, key=lambda side: -side.length * style.draws.uniform(0.7, 1.3)):
        cursor = -side.length / 2 + 2 * GAP
        while row and cursor + row[0].width < side.length / 2 - GAP:
            placed = space.place(row[0], side.place(cursor + row[0].width / 2, GAP))
            if placed is not None and row[0].label in ("counter", "stove"):
                cabinet = kitchen.wall_cabinet(style, row[0].width - 0.01, front)
                space.place(cabinet, Placement(placed.x, placed.z, placed.turn, 1.45))
            cursor += (row.pop(0).width + 0.004) if placed is not None else 0.15
    dining_group(space, style)
    if style.draws.chance(0.5):
        space.against_wall(seating.stool(style))


def _bathroom(space: RoomSpace, style: Style) -> None:
    space.against_wall(bathroom.bathtub(style), tries=40)
    space.against_wall(bathroom.toilet(style), tries=30)
    basin = space.against_wall(bathroom.washbasin(style), tries=30)
    if basin is not None:
        space.place(bathroom.mirror_cabinet(style), Placement(basin.x, basin.z, basin.turn, 1.3))
    space.against_wall(bathroom.washing_machine(style), tries=20)
    if style.draws.chance(0.5):
        space.against_wall(seating.stool(style))
    lay_rug(space, style, Placement(*space.room.centre, style.draws.choice(space.sides).turn))


def _hallway(space: RoomSpace, style: Style) -> None:
    space.against_wall(decor.coat_rack(style), up=style.draws.uniform(0.75, 0.85), gap=0.002)
    for piece in (storage.shoe_cabinet, storage.shoe_cabinet, seating.stool):
        space.against_wall(piece(style))
    lay_rug(space, style, Placement(*space.room.centre, style.draws.choice(space.sides).turn))


ROOMS: dict[str, Callable[[RoomSpace, Style], None]] = {
    "living room": _living_room,
    "bedroom": _bedroom,
    "study": _study,
    "kitchen": _kitchen,
    "bathroom": _bathroom,
    "hallway": _hallway,
}
"""How each kind of room is furnished."""
