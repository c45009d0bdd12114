"""Kitchen furniture: worktops, wall cabinets and appliances, 0.6 m deep to form a row."""

from deux_plugins.scenes.parts.furniture_clutter import book_row, bowl, carton, vase
from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.surfaces import Surface

DEPTH = 0.6
WORKTOP = 0.9
"""Depth and height of all kitchen furniture, metres."""


def counter(style: Style, width: float, front: Surface, top: Surface) -> Model:
    """A worktop on cabinets, with small things along the wall."""
    model = Model("counter", width, DEPTH, WORKTOP, front=0.55)
    _base(model, front, style)
    _worktop(model, -width / 2, width / 2, top)
    left = -width / 2 + 0.2
    while left < width / 2 - 0.2:
        model.add(style.draws.choice((bowl, vase, carton))(style), left, WORKTOP, 0.08)
        left += style.draws.uniform(0.3, 0.6)
    return model


def sink_unit(style: Style, front: Surface, top: Surface) -> Model:
    """A cabinet with a basin let into its top, and a tap."""
    width, steel = 0.8, style.metal()
    model = Model("counter", width, DEPTH, WORKTOP + 0.25, front=0.55)
    _base(model, front, style)
    half, inner = width / 2, 0.26
    model.box((-half, WORKTOP - 0.03, 0.0), (-inner, WORKTOP, DEPTH), top)
    model.box((inner, WORKTOP - 0.03, 0.0), (half, WORKTOP, DEPTH), top)
    model.box((-inner, WORKTOP - 0.03, 0.0), (inner, WORKTOP - 0.001, 0.12), top)
    model.box((-inner, WORKTOP - 0.03, DEPTH - 0.1), (inner, WORKTOP - 0.001, DEPTH), top)
    model.box((-inner, WORKTOP - 0.14, 0.12), (inner, WORKTOP - 0.12, DEPTH - 0.1), steel, label="sink")
    model.box((-0.02, WORKTOP, 0.05), (0.02, WORKTOP + 0.22, 0.09), steel, label="sink")
    model.box((-0.015, WORKTOP + 0.18, 0.09), (0.015, WORKTOP + 0.21, 0.24), steel, label="sink")
    return model


def stove(style: Style) -> Model:
    """A stove with an oven door and four plates."""
    enamel, steel = style.pick("enamel", "metal"), style.metal()
    model = Model("stove", 0.6, DEPTH, WORKTOP, front=0.55)
    model.box((-0.298, 0.0, 0.005), (0.298, WORKTOP - 0.02, DEPTH - 0.03), enamel)
    model.box((-0.3, WORKTOP - 0.02, 0.0), (0.3, WORKTOP, DEPTH), style.pick("marble", "metal"))
    model.box((-0.26, 0.16, DEPTH - 0.03), (0.26, 0.68, DEPTH - 0.01), steel, front=style.pick("leather"))
    model.box((-0.22, 0.64, DEPTH - 0.01), (0.22, 0.665, DEPTH + 0.01), steel)
    for x in (-0.21, -0.07, 0.07, 0.21):
        model.turned((x, 0.78, DEPTH - 0.03), [(0.0, 0.025), (0.03, 0.02)], steel, sides=6, axis="z")
    for x in (-0.14, 0.14):
        for z in (0.16, 0.43):
            model.turned((x, WORKTOP, z), [(0.002, 0.1), (0.015, 0.095)], steel, sides=8)
    return model


def refrigerator(style: Style) -> Model:
    """A tall refrigerator with two doors and notes stuck on it."""
    width, height = style.draws.uniform(0.58, 0.7), style.draws.uniform(1.6, 1.9)
    body = style.pick("enamel", "metal")
    model = Model("refrigerator", width, 0.64, height, front=0.5)
    half, split = width / 2, height * style.draws.uniform(0.3, 0.65)
    model.box((-half, 0.02, 0.0), (half, height, 0.58), body)
    for foot, top in ((0.06, split - 0.005), (split + 0.005, height - 0.01)):
        model.box((-half + 0.004, foot, 0.58), (half - 0.004, top, 0.62), body)
        model.box(
            (-half + 0.04, (foot + top) / 2 - 0.12, 0.62),
            (-half + 0.065, (foot + top) / 2 + 0.12, 0.64),
            style.metal(),
        )
    for index in range(style.draws.integer(2, 4)):
        x, y = style.draws.uniform(-half + 0.12, half - 0.16), style.draws.uniform(split + 0.1, height - 0.25)
        model.box((x, y, 0.62), (x + 0.1, y + 0.14, 0.623 + 0.002 * index), style.picture(), label="picture")
    return model


def wall_cabinet(style: Style, width: float, front: Surface) -> Model:
    """A cabinet above the worktop, or sometimes a board with books."""
    model = Model("cabinet", width, 0.33, 0.62, hangs=True)
    half = width / 2
    if style.draws.chance(0.25):
        model.box((-half, 0.0, 0.0), (half, 0.03, 0.3), style.wood())
        model.add(book_row(style, width - 0.05, 0.24, 0.28), 0.0, 0.03, 0.01)
        return model
    model.box((-half, 0.0, 0.0), (half, 0.62, 0.31), style.wood())
    count = max(round(width / 0.5), 1)
    for index in range(count):
        left = -half + index * width / count
        model.box((left + 0.006, 0.01, 0.31), (left + width / count - 0.006, 0.61, 0.327), front)
    return model


def _base(model: Model, front: Surface, style: Style) -> None:
    """Cabinets under a worktop, with doors and handles."""
    half = model.width / 2
    # The sides are inset by a few millimetres, to avoid coplanar faces of neighbours.
    model.box((-half + 0.003, 0.0, 0.01), (half - 0.003, WORKTOP - 0.15, DEPTH - 0.05), style.wood())
    model.box((-half + 0.003, WORKTOP - 0.15, DEPTH - 0.09), (half - 0.003, WORKTOP - 0.03, DEPTH - 0.05), front)
    model.box((-half + 0.003, WORKTOP - 0.15, 0.01), (-half + 0.02, WORKTOP - 0.03, DEPTH - 0.09), front)
    model.box((half - 0.02, WORKTOP - 0.15, 0.01), (half - 0.003, WORKTOP - 0.03, DEPTH - 0.09), front)
    count = max(round(model.width / 0.5), 1)
    step = model.width / count
    for index in range(count):
        left = -half + index * step
        model.box((left + 0.01, 0.12, DEPTH - 0.05), (left + step - 0.01, WORKTOP - 0.05, DEPTH - 0.03), front)
        model.box(
            (left + step / 2 - 0.08, WORKTOP - 0.12, DEPTH - 0.03),
            (left + step / 2 + 0.08, WORKTOP - 0.1, DEPTH - 0.015),
            style.metal(),
        )


def _worktop(model: Model, left: float, right: float, top: Surface) -> None:
    model.box((left, WORKTOP - 0.03, 0.0), (right, WORKTOP, DEPTH), top)
