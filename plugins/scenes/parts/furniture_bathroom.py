"""Bathrooms: tub, toilet, basin, washing machine."""

from deux_plugins.scenes.parts.furniture_clutter import bowl, carton, vase
from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style


def bathtub(style: Style) -> Model:
    """A hollow bathtub with a tap at one end."""
    width, depth, height, rim = style.draws.uniform(1.5, 1.75), style.draws.uniform(0.7, 0.78), 0.56, 0.07
    apron, glaze = style.pick("wall tiles", "enamel", "marble"), style.ceramic()
    model = Model("bathtub", width, depth, height, front=0.3)
    half = width / 2
    model.box((-half, 0.0, 0.0), (half, height, rim), apron)
    model.box((-half, 0.0, depth - rim), (half, height, depth), apron)
    model.box((-half + 0.001, 0.0, rim), (-half + rim, height - 0.001, depth - rim), glaze)
    model.box((half - rim, 0.0, rim), (half - 0.001, height - 0.001, depth - rim), glaze)
    model.box((-half + rim, 0.0, rim), (half - rim, 0.15, depth - rim), glaze)
    model.box(
        (-half + 0.02, height, depth / 2 - 0.02),
        (-half + 0.05, height + 0.15, depth / 2 + 0.02),
        style.metal(),
    )
    model.box(
        (-half + 0.05, height + 0.1, depth / 2 - 0.015),
        (-half + 0.16, height + 0.13, depth / 2 + 0.015),
        style.metal(),
    )
    return model


def toilet(style: Style) -> Model:
    """A bowl, a seat and a cistern."""
    glaze = style.pick("enamel")
    model = Model("toilet", 0.4, 0.66, 0.8, front=0.45)
    model.turned((0.0, 0.0, 0.42), [(0.0, 0.12), (0.18, 0.11), (0.36, 0.19), (0.4, 0.19)], glaze)
    model.turned((0.0, 0.4, 0.42), [(0.002, 0.195), (0.03, 0.19)], style.pick("paint", "wood"))
    model.box((-0.12, 0.0, 0.05), (0.12, 0.38, 0.35), glaze)
    model.box((-0.19, 0.38, 0.01), (0.19, 0.76, 0.2), glaze)
    model.box((-0.2, 0.76, 0.0), (0.2, 0.79, 0.21), glaze)
    model.box((-0.03, 0.79, 0.08), (0.03, 0.8, 0.13), style.metal())
    return model


def washbasin(style: Style) -> Model:
    """A basin on a cabinet or a pedestal, with a tap."""
    width, height, glaze = style.draws.uniform(0.5, 0.75), 0.85, style.ceramic()
    model = Model("sink", width, 0.46, height + 0.16, front=0.45)
    half, rim = width / 2, 0.05
    if style.draws.chance(0.6):
        model.box((-half + 0.02, 0.12, 0.01), (half - 0.02, height - 0.16, 0.42), style.wood(), label="cabinet")
        model.box((-half + 0.03, 0.14, 0.42), (half - 0.03, height - 0.18, 0.435), style.front(), label="cabinet")
    else:
        model.turned((0.0, 0.0, 0.22), [(0.0, 0.13), (0.1, 0.1), (height - 0.16, 0.12)], glaze)
    model.box((-half, height - 0.16, 0.0), (half, height - 0.1, 0.46), glaze)
    model.box((-half, height - 0.1, 0.0), (half, height, 0.1), glaze)
    model.box((-half, height - 0.1, 0.46 - rim), (half, height, 0.46), glaze)
    for left in (-half, half - rim):
        model.box((left, height - 0.1, 0.1), (left + rim, height - 0.001, 0.46 - rim), glaze)
    model.box((-0.02, height, 0.03), (0.02, height + 0.15, 0.07), style.metal())
    model.box((-0.015, height + 0.11, 0.07), (0.015, height + 0.14, 0.19), style.metal())
    model.add(style.draws.choice((vase, carton))(style), -half + 0.09, height, 0.0)
    return model


def washing_machine(style: Style) -> Model:
    """A washing machine with a round door, and something on top."""
    model = Model("washing machine", 0.6, 0.58, 0.85, front=0.5)
    body = style.pick("enamel")
    model.box((-0.3, 0.0, 0.0), (0.3, 0.85, 0.55), body)
    model.turned((0.0, 0.42, 0.55), [(0.0, 0.2), (0.02, 0.19), (0.03, 0.14)], style.metal(), sides=12, axis="z")
    model.box((-0.27, 0.72, 0.55), (0.27, 0.82, 0.56), style.metal())
    model.add(style.draws.choice((bowl, carton))(style), style.draws.uniform(-0.12, 0.12), 0.85, 0.15)
    return model


def mirror_cabinet(style: Style) -> Model:
    """A shallow cabinet above the basin; its doors are painted, because there are no reflections."""
    width = style.draws.uniform(0.45, 0.65)
    model = Model("cabinet", width, 0.14, 0.6, hangs=True)
    model.box((-width / 2, 0.0, 0.0), (width / 2, 0.6, 0.12), style.wood())
    for left in (-width / 2 + 0.004, 0.004):
        model.box(
            (left, 0.01, 0.12),
            (left + width / 2 - 0.008, 0.59, 0.135),
            style.pick("metal", "marble", "paint"),
        )
    return model
