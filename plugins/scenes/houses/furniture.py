"""Furniture that only houses have: racks of boxes, stacks of boxes, benches, pillars."""

from deux_plugins.scenes.parts.furniture_clutter import carton, vase
from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style


def rack(style: Style) -> Model:
    """Open metal shelves with boxes on them."""
    width, depth = style.draws.uniform(0.9, 1.3), style.draws.uniform(0.4, 0.5)
    count, step = style.draws.integer(3, 4), style.draws.uniform(0.42, 0.5)
    height = round(count * step + 0.15, 3)
    model = Model("shelf", width, depth, height, front=0.3)
    metal, half, post = style.metal(), width / 2, 0.035
    for left in (-half, half - post):
        for back in (0.0, depth - post):
            model.box((left, 0.0, back), (left + post, height, back + post), metal)
    for index in range(count + 1):
        foot = 0.08 + index * step
        model.box((-half + post, foot, 0.004), (half - post, foot + 0.02, depth - 0.004), metal)
        if index < count:
            _fill(model, style, foot + 0.02, step - 0.06)
    return model


def _fill(model: Model, style: Style, foot: float, height: float) -> None:
    """Boxes and small things side by side on a board, with gaps."""
    left, end = -model.width / 2 + 0.05, model.width / 2 - 0.05
    while end - left > 0.16:
        width = min(style.draws.uniform(0.16, 0.42), end - left)
        if style.draws.chance(0.75):
            low, depth = style.draws.uniform(0.01, 0.05), model.depth * style.draws.uniform(0.6, 0.85)
            top = foot + height * style.draws.uniform(0.5, 1.0)
            surface = style.pick("cardboard", "cardboard", "paint", "metal", "weave")
            model.box((left + 0.004, foot, low), (left + width - 0.008, top, low + depth), surface, label="box")
        elif width > 0.3:
            model.add(style.draws.choice((vase, carton))(style), left + width / 2, foot, 0.08)
        left = round(left + width, 3)


def stack(style: Style) -> Model:
    """One to three large boxes on one another."""
    width, depth = style.draws.uniform(0.4, 0.65), style.draws.uniform(0.35, 0.55)
    surface, foot = style.pick("cardboard", "cardboard", "paint", "wood"), 0.0
    model = Model("box", width, depth, 0.0)
    for _ in range(style.draws.integer(1, 3)):
        top = round(foot + style.draws.uniform(0.25, 0.45), 3)
        inset = style.draws.uniform(0.0, 0.06)
        model.box((-width / 2 + inset, foot, inset), (width / 2 - 0.01, top, depth - 0.01), surface)
        foot = top
    model.height = foot
    return model


def bench(style: Style) -> Model:
    """A bench without a back, on two boards."""
    width, depth, height = style.draws.uniform(1.1, 1.8), 0.36, style.draws.uniform(0.42, 0.48)
    model = Model("stool", width, depth, height)
    wood, half = style.wood(), width / 2
    model.box((-half, height - 0.04, 0.0), (half, height, depth), wood)
    for left in (-half + 0.1, half - 0.16):
        model.box((left, 0.0, 0.03), (left + 0.06, height - 0.04, depth - 0.03), wood)
    return model


def pillar(style: Style, height: float) -> Model:
    """A square or round pillar from the floor to the ceiling."""
    half = style.draws.uniform(0.14, 0.24)
    surface = style.pick("distemper", "plaster", "brick", "mosaic")
    # The top is slightly above the ceiling, to avoid coplanar faces.
    model = Model("wall", 2 * half, 2 * half, height - 0.025)
    if style.draws.chance(0.5):
        model.box((-half, 0.0, 0.0), (half, height + 0.01, 2 * half), surface)
    else:
        model.turned((0.0, 0.0, half), [(0.0, half), (height + 0.01, half)], surface, sides=12)
    return model
