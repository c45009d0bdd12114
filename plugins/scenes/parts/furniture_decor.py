"""Decoration: pictures, rugs, curtains, lamps, plants, radiators, coats, and the front door."""

from deux_plugins.scenes.parts.shapes import Model, rectangle
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.surfaces import Surface


def picture(style: Style) -> Model:
    """A framed painting."""
    width, height = style.draws.uniform(0.35, 1.0), style.draws.uniform(0.35, 0.8)
    model = Model("picture", width, 0.03, height, hangs=True)
    frame, half, border = style.pick("wood", "paint", "metal"), width / 2, 0.035
    for left in (-half, half - border):
        model.box((left, 0.0, 0.0), (left + border, height, 0.03), frame)
    for foot in (0.0, height - border):
        model.box((-half + border, foot, 0.0), (half - border, foot + border, 0.028), frame)
    low, size = (-half + border, border, 0.012), (width - 2 * border, height - 2 * border)
    model.parts.append(rectangle(low, (size[0], 0, 0), (0, size[1], 0), style.picture(), "picture"))
    return model


def rug(style: Style) -> Model:
    """A rug, one centimetre thick, over which a robot can drive."""
    width, depth = style.draws.uniform(1.1, 2.4), style.draws.uniform(0.9, 1.7)
    model = Model("rug", width, depth, 0.01)
    surface = style.pick("rug", "rug", "rug", "plaid")
    model.box((-width / 2, 0.0, 0.0), (width / 2, 0.01, depth), surface)
    return model


def curtain(style: Style, height: float, surface: Surface) -> Model:
    """One of a pair of curtains, with folds."""
    folds = style.draws.integer(3, 5)
    width = folds * 0.09
    model = Model("curtain", width, 0.1, height)
    for index in range(folds):
        left, back = -width / 2 + index * 0.09, 0.03 if index % 2 else 0.055
        model.box((left, 0.02, back), (left + 0.09, height - 0.04, back + 0.03), surface)
    model.box((-width / 2 - 0.03, height - 0.04, 0.05), (width / 2 + 0.03, height - 0.01, 0.08), style.metal())
    return model


def radiator(style: Style, width: float) -> Model:
    """A ribbed radiator for under a window."""
    model = Model("radiator", width, 0.12, 0.66)
    surface, count = style.pick("enamel", "paint", "metal"), max(int(width / 0.16), 3)
    step = width / count
    for index in range(count):
        left = -width / 2 + index * step
        model.box((left + 0.012, 0.1, 0.03), (left + step - 0.012, 0.66, 0.12), surface)
    model.box((-width / 2, 0.15, 0.05), (width / 2, 0.2, 0.1), surface)
    model.box((-width / 2, 0.55, 0.05), (width / 2, 0.6, 0.1), surface)
    return model


def plant(style: Style) -> Model:
    """A potted plant with a bushy or a tall crown."""
    radius, height = style.draws.uniform(0.13, 0.2), style.draws.uniform(0.7, 1.6)
    leaf, pot = style.pick("foliage"), style.pick("enamel", "weave", "brick", "wood")
    model = Model("plant", 0.46, 0.46, height)
    model.turned((0.0, 0.0, 0.23), [(0.0, radius * 0.7), (0.26, radius), (0.3, radius)], pot, label="vase")
    if height > 1.0:
        model.turned((0.0, 0.3, 0.23), [(0.0, 0.03), (height - 0.7, 0.02)], style.pick("wood"), sides=6)
    foot = 0.3 if height <= 1.0 else height - 0.65
    blobs = style.draws.integer(3, 5)
    for index in range(blobs):
        size = style.draws.uniform(0.09, 0.15)
        x, z = style.draws.uniform(-0.08, 0.08), 0.23 + style.draws.uniform(-0.08, 0.08)
        low = foot + (height - foot - 2 * size) * index / max(blobs - 1, 1)
        profile = [(0.0, size * 0.35), (size * 0.5, size), (size * 1.3, size * 0.9), (size * 2.0, size * 0.3)]
        model.turned((x, low + 0.002, z), profile, leaf, sides=8)
    return model


def floor_lamp(style: Style) -> Model:
    """A standing lamp."""
    height = style.draws.uniform(1.45, 1.75)
    model = Model("lamp", 0.4, 0.4, height)
    model.turned(
        (0.0, 0.0, 0.2),
        [(0.0, 0.14), (0.03, 0.13), (0.05, 0.02), (height - 0.25, 0.015)],
        style.metal(),
        sides=8,
    )
    model.turned((0.0, height - 0.3, 0.2), [(0.0, 0.2), (0.3, 0.12)], style.pick("linen", "weave", "plaid"), sides=10)
    return model


def ceiling_lamp(style: Style, ceiling: float) -> Model:
    """A lamp that hangs from the ceiling, above head height."""
    drop, radius = style.draws.uniform(0.2, 0.45), style.draws.uniform(0.13, 0.24)
    model = Model("lamp", 2 * radius, 2 * radius, drop)
    foot = ceiling - drop
    shade = [(0.0, radius), (0.05, radius * 0.95), (0.14, radius * 0.45)]
    model.turned((0.0, foot, radius), shade, style.pick("weave", "linen", "paint", "metal"), sides=10)
    model.turned((0.0, foot + 0.14, radius), [(0.0, 0.015), (drop - 0.15, 0.015)], style.metal(), sides=6)
    model.turned((0.0, ceiling - 0.03, radius), [(0.0, 0.05), (0.028, 0.06)], style.metal(), sides=8)
    return model


def coat_rack(style: Style) -> Model:
    """A board with hooks and coats."""
    width = style.draws.uniform(0.7, 1.2)
    model = Model("coat rack", width, 0.2, 1.0)
    model.box((-width / 2, 0.85, 0.0), (width / 2, 1.0, 0.03), style.wood())
    count = int(width / 0.24)
    for index in range(count):
        x = -width / 2 + (index + 0.5) * width / count
        model.box((x - 0.01, 0.88, 0.03), (x + 0.01, 0.9, 0.09), style.metal())
        if style.draws.chance(0.65):
            length, half = style.draws.uniform(0.5, 0.85), style.draws.uniform(0.07, 0.1)
            model.box((x - half, 0.87 - length, 0.034), (x + half, 0.875, 0.1 + half), style.cloth())
    return model


def front_door(style: Style) -> Model:
    """The closed door to the staircase, in its frame."""
    model = Model("door", 1.0, 0.06, 2.1, front=0.8)
    leaf, frame = style.front(), style.trim
    model.box((-0.43, 0.005, 0.0), (0.43, 2.03, 0.035), leaf)
    for foot, top in ((0.15, 0.9), (1.05, 1.9)):
        model.box((-0.32, foot, 0.035), (0.32, top, 0.045), leaf)
    for left in (-0.5, 0.43):
        model.box((left, 0.0, 0.0), (left + 0.07, 2.03, 0.05), frame, label="door frame")
    model.box((-0.5, 2.03, 0.0), (0.5, 2.1, 0.05), frame, label="door frame")
    model.box((0.34, 1.0, 0.045), (0.38, 1.03, 0.06), style.metal())
    return model
