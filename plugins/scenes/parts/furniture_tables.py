"""Tables and desks with small things on them."""

from deux_plugins.scenes.parts.furniture_clutter import book_pile, bowl, carton, computer, table_lamp, vase
from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.surfaces import Surface


def dining_table(style: Style) -> Model:
    """A rectangular table for four to six people."""
    width, depth = style.draws.uniform(1.15, 1.7), style.draws.uniform(0.75, 0.9)
    model = _four_legged("table", width, depth, style.draws.uniform(0.72, 0.77), style)
    _strew(model, style, style.draws.integer(2, 4))
    return model


def round_table(style: Style) -> Model:
    """A round table on one foot."""
    radius, height = style.draws.uniform(0.42, 0.6), style.draws.uniform(0.7, 0.76)
    wood = style.wood()
    model = Model("table", 2 * radius, 2 * radius, height)
    foot = [(0.0, radius * 0.6), (0.04, radius * 0.55), (0.07, 0.06), (height - 0.04, 0.05)]
    model.turned((0.0, 0.0, radius), foot, wood)
    model.turned((0.0, height - 0.04, radius), [(0.0, radius - 0.02), (0.04, radius)], style.stone(), sides=12)
    model.add(style.draws.choice((vase, bowl, book_pile))(style), 0.0, height, radius - 0.1)
    return model


def coffee_table(style: Style) -> Model:
    """A low table with a lower board."""
    width, depth, height = (
        style.draws.uniform(0.8, 1.2),
        style.draws.uniform(0.48, 0.62),
        style.draws.uniform(0.36, 0.45),
    )
    model = _four_legged("table", width, depth, height, style)
    model.box((-width / 2 + 0.05, 0.12, 0.05), (width / 2 - 0.05, 0.14, depth - 0.05), style.wood())
    _strew(model, style, style.draws.integer(1, 3))
    return model


def desk(style: Style) -> Model:
    """A desk with a chest of drawers, a computer, a lamp and books."""
    width, depth, height = style.draws.uniform(1.1, 1.5), style.draws.uniform(0.58, 0.7), 0.74
    wood, front = style.wood(), style.front()
    model = Model("desk", width, depth, height, front=0.45)
    half = width / 2
    model.box((-half, height - 0.035, 0.0), (half, height, depth), wood)
    model.box((half - 0.4, 0.02, 0.03), (half - 0.03, height - 0.035, depth - 0.04), wood)
    for index in range(3):
        foot = 0.05 + index * 0.22
        model.box((half - 0.385, foot, depth - 0.04), (half - 0.045, foot + 0.2, depth - 0.025), front)
    for z in (0.02, depth - 0.06):
        model.box((-half + 0.02, 0.0, z), (-half + 0.06, height - 0.035, z + 0.04), style.metal())
    model.add(computer(style), -0.12, height, 0.1)
    model.add(table_lamp(style), half - 0.16, height, 0.1)
    model.add(style.draws.choice((book_pile, carton))(style), -half + 0.2, height, 0.16)
    return model


def _four_legged(label: str, width: float, depth: float, height: float, style: Style) -> Model:
    """A board on an apron and four legs, square or turned."""
    top, legs = style.wood(), style.wood()
    model = Model(label, width, depth, height)
    half, inset = width / 2, 0.05
    model.box((-half, height - 0.035, 0.0), (half, height, depth), top)
    model.box((-half + 0.08, height - 0.1, 0.08), (half - 0.08, height - 0.035, depth - 0.08), legs)
    square = style.draws.chance(0.5)
    for x in (-half + inset, half - inset):
        for z in (inset, depth - inset):
            _leg(model, x, z, height - 0.035, square, legs)
    return model


def _leg(model: Model, x: float, z: float, height: float, square: bool, surface: Surface) -> None:
    if square:
        model.box((x - 0.03, 0.0, z - 0.03), (x + 0.03, height, z + 0.03), surface)
    else:
        model.turned((x, 0.0, z), [(0.0, 0.022), (height, 0.036)], surface, sides=6)


def _strew(model: Model, style: Style, count: int) -> None:
    """Put small things side by side on a table."""
    slot = (model.width - 0.1) / count
    for index in range(count):
        thing = style.draws.choice((book_pile, vase, bowl, carton))(style)
        x = -model.width / 2 + 0.05 + (index + style.draws.uniform(0.42, 0.58)) * slot
        if thing.width < slot:
            model.add(thing, x, model.height, style.draws.uniform(0.06, max(model.depth - thing.depth - 0.05, 0.06)))
