"""Small things on furniture; their origin is at the bottom, in the middle of their back."""

from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style


def book_pile(style: Style) -> Model:
    """A few books lying on one another."""
    model = Model("book", 0.26, 0.2, 0.12)
    foot = 0.0
    for _ in range(style.draws.integer(2, 4)):
        thickness, half = style.draws.uniform(0.02, 0.04), style.draws.uniform(0.09, 0.13)
        shift = style.draws.uniform(0.0, 0.03)
        model.box(
            (-half, foot, shift),
            (half, foot + thickness, shift + 0.16),
            style.pick("weave", "leather", "abstract"),
        )
        foot += thickness
    return model


def book_row(style: Style, width: float, depth: float, height: float) -> Model:
    """Books standing side by side on a shelf, in groups of one height each, with gaps."""
    model = Model("book", width, depth, height)
    left = 0.0
    while width - left > 0.1:
        step = min(style.draws.uniform(0.12, 0.36), width - left)
        if style.draws.chance(0.85):
            top, out = height * style.draws.uniform(0.68, 0.92), depth * style.draws.uniform(0.65, 0.92)
            low = -width / 2 + left
            model.box((low + 0.004, 0.0, 0.005), (low + step - 0.004, top, out), style.pick("books"))
        elif step > 0.16 and height > 0.25:
            model.add(style.draws.choice((vase, carton))(style), -width / 2 + left + step / 2, 0.0, 0.04)
        left += step
    return model


def vase(style: Style) -> Model:
    """A turned vase."""
    height, radius = style.draws.uniform(0.14, 0.22), style.draws.uniform(0.045, 0.07)
    model = Model("vase", 2 * radius, 2 * radius, height)
    profile = [
        (0.0, radius * 0.6),
        (height * 0.35, radius),
        (height * 0.8, radius * 0.45),
        (height, radius * 0.6),
    ]
    model.turned((0.0, 0.0, radius), profile, style.pick("enamel", "marble", "paint", "plaid"), sides=8)
    return model


def bowl(style: Style) -> Model:
    """A shallow bowl."""
    radius = style.draws.uniform(0.09, 0.15)
    model = Model("vase", 2 * radius, 2 * radius, 0.08)
    profile = [(0.0, radius * 0.5), (0.05, radius * 0.9), (0.08, radius)]
    model.turned((0.0, 0.0, radius), profile, style.pick("enamel", "wood", "metal"), sides=10)
    return model


def carton(style: Style) -> Model:
    """A small box."""
    half, depth, height = (
        style.draws.uniform(0.06, 0.13),
        style.draws.uniform(0.1, 0.16),
        style.draws.uniform(0.08, 0.18),
    )
    model = Model("box", 2 * half, depth, height)
    surface = style.pick("cardboard", "plaid", "abstract", "paint")
    model.box((-half, 0.0, 0.0), (half, height, depth), surface)
    return model


def computer(style: Style) -> Model:
    """A screen with a keyboard in front of it."""
    half = style.draws.uniform(0.24, 0.31)
    model = Model("computer", 2 * half, 0.4, 0.48)
    model.box((-0.1, 0.0, 0.0), (0.1, 0.02, 0.16), style.metal())
    model.box((-0.025, 0.02, 0.06), (0.025, 0.2, 0.09), style.metal())
    model.box((-half, 0.12, 0.09), (half, 0.46, 0.12), style.metal(), front=style.picture())
    model.box((-0.2, 0.0, 0.24), (0.2, 0.02, 0.37), style.metal())
    return model


def table_lamp(style: Style) -> Model:
    """A small lamp with a shade."""
    model = Model("lamp", 0.2, 0.2, 0.42)
    model.turned((0.0, 0.0, 0.1), [(0.0, 0.07), (0.03, 0.06), (0.06, 0.02), (0.24, 0.015)], style.metal(), sides=8)
    model.turned((0.0, 0.22, 0.1), [(0.0, 0.1), (0.18, 0.065)], style.pick("linen", "weave", "plaid"), sides=8)
    return model
