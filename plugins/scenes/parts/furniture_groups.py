"""Furniture that is placed together: a desk and its chair, a table with chairs, windows with curtains, lamps."""

from deux_plugins.scenes.parts import furniture_decor as decor
from deux_plugins.scenes.parts import furniture_seating as seating
from deux_plugins.scenes.parts import furniture_tables as tables
from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.mesh_builder import NORTH, Placement
from deux_plugins.scenes.parts.placement import GAP, RoomSpace
from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style

Turn = tuple[float, float]


def desk_group(space: RoomSpace, style: Style) -> None:
    """Add a desk with a chair pushed under it."""
    desk = tables.desk(style)
    placed = space.against_wall(desk, tries=20)
    if placed is not None:
        chair = seating.chair(style)
        right = style.draws.uniform(-0.25, 0.0)
        place = placed.beside(right, desk.depth + chair.depth - 0.12, _aslant(NORTH, style.draws))
        space.place(chair, place, ignoring=placed)


def dining_group(space: RoomSpace, style: Style) -> None:
    """Add a table with chairs pushed under it on all sides with enough space."""
    table = style.draws.choice((tables.dining_table, tables.round_table))(style)
    placed = space.in_the_open(table, tries=20) or space.against_wall(table)
    if placed is None:
        return
    half, depth = table.width / 2, table.depth
    offsets = (-half / 2, half / 2) if table.width > table.depth + 0.2 else (0.0,)
    spots = [(x, -0.38, (1.0, 0.0)) for x in offsets] + [(x, depth + 0.38, NORTH) for x in offsets]
    spots += [(-half - 0.38, depth / 2, (0.0, 1.0)), (half + 0.38, depth / 2, (0.0, -1.0))]
    model = seating.chair(style)
    for right, out, turn in spots:
        out += style.draws.uniform(-0.06, 0.06)
        space.place(model, placed.beside(right, out, _aslant(turn, style.draws)), ignoring=placed)


def _aslant(turn: Turn, draws: Draws) -> Turn:
    """Change a turn by up to 17 degrees; a rational function of t = tan(angle / 2), to be exact on every machine."""
    t = draws.uniform(-0.15, 0.15)
    cosine, sine = (1.0 - t * t) / (1.0 + t * t), 2.0 * t / (1.0 + t * t)
    return turn[0] * cosine - turn[1] * sine, turn[1] * cosine + turn[0] * sine


def lay_rug(space: RoomSpace, style: Style, middle: Placement) -> None:
    """Add a rug near a placement, with up to four tries of different sizes."""
    for _ in range(4):
        model: Model = decor.rug(style)
        if space.lay(model, middle.beside(0.0, -0.1)) or space.lay(model, middle.beside(0.0, -model.depth / 2)):
            return


def dress_windows(space: RoomSpace, style: Style) -> None:
    """Add curtains on both sides of each window, and a radiator below it."""
    curtained = space.room.kind != "bathroom" and style.draws.chance(0.7)
    cloth = style.cloth()
    for side, low, high, bottom, top in space.windows:
        if curtained:
            rail = min(top + 0.18, space.room.height - 0.05)
            # If furniture stands at the window, the curtain ends above it.
            for right in (low, high):
                for foot in (0.0, bottom - 0.15):
                    model = decor.curtain(style, round(rail - foot, 3), cloth)
                    outer = right + (0.04 - model.width / 2) * (1 if right == low else -1)
                    if space.place(model, side.place(outer, GAP, foot), at_window=True):
                        break
        if bottom > 0.8 and style.draws.chance(0.6):
            space.place(decor.radiator(style, min(high - low - 0.1, 1.1)), side.place((low + high) / 2, GAP))


def hang_lamp(space: RoomSpace, style: Style, middle: Placement) -> None:
    """Add a lamp to the ceiling."""
    model = decor.ceiling_lamp(style, space.room.height)
    space.hang_free(model, middle.beside(0.0, -model.depth / 2))
