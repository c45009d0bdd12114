"""Sofas, armchairs, chairs and stools."""

from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style


def sofa(style: Style) -> Model:
    """A sofa with two or three seats, armrests and cushions."""
    width, depth = style.draws.uniform(1.5, 2.2), style.draws.uniform(0.82, 0.95)
    model = _upholstered("sofa", width, depth, 3 if width > 1.9 else 2, style)
    for side in (-1, 1):
        if style.draws.chance(0.7):
            model.add(cushion(style), side * (width / 2 - 0.45), 0.45, 0.28)
    return model


def armchair(style: Style) -> Model:
    """An upholstered chair for one."""
    return _upholstered("armchair", style.draws.uniform(0.75, 0.9), style.draws.uniform(0.75, 0.88), 1, style)


def _upholstered(label: str, width: float, depth: float, seats: int, style: Style) -> Model:
    cover, seat_cover = style.upholstery(), style.cloth()
    height, arm = style.draws.uniform(0.75, 0.9), style.draws.uniform(0.14, 0.2)
    model = Model(label, width, depth, height, front=0.35)
    half = width / 2
    for x in (-half + 0.06, half - 0.12):
        for z in (0.06, depth - 0.12):
            model.box((x, 0.0, z), (x + 0.06, 0.1, z + 0.06), style.metal())
    model.box((-half + 0.01, 0.1, 0.02), (half - 0.01, 0.3, depth - 0.03), cover)
    model.box((-half + arm / 2, 0.3, 0.0), (half - arm / 2, height, 0.24), cover)
    for left in (-half, half - arm):
        model.box((left, 0.08, 0.01), (left + arm, 0.58, depth - 0.01), cover)
    seat = (width - 2 * arm) / seats
    for index in range(seats):
        left = -half + arm + index * seat
        model.box((left + 0.006, 0.29, 0.22), (left + seat - 0.006, 0.45, depth), seat_cover)
        model.box((left + 0.02, 0.45, 0.2), (left + seat - 0.02, height - 0.06, 0.34), seat_cover)
    return model


def cushion(style: Style) -> Model:
    """A loose cushion, standing."""
    model = Model("cushion", 0.42, 0.14, 0.38)
    model.turned((0.0, 0.17, 0.06), [(0.0, 0.14), (0.06, 0.23), (0.12, 0.15)], style.cloth(), sides=8, axis="z")
    return model


def chair(style: Style) -> Model:
    """A chair with four legs and a back with slats or a panel."""
    width, depth, seat = (
        style.draws.uniform(0.4, 0.48),
        style.draws.uniform(0.42, 0.5),
        style.draws.uniform(0.43, 0.47),
    )
    height = style.draws.uniform(0.82, 0.98)
    frame, cover = style.wood(), style.cloth() if style.draws.chance(0.6) else style.wood()
    model = Model("chair", width, depth, height)
    half, leg = width / 2, 0.04
    for x in (-half, half - leg):
        model.box((x, 0.0, depth - leg), (x + leg, seat - 0.01, depth), frame)
        model.box((x, 0.0, 0.0), (x + leg, height, leg), frame)
    model.box((-half + 0.005, seat - 0.04, 0.005), (half - 0.005, seat, depth + 0.005), cover)
    if style.draws.chance(0.5):
        model.box((-half + leg, seat + 0.15, 0.008), (half - leg, height - 0.02, 0.032), cover)
    else:
        for foot in (0.14, 0.26, 0.38):
            if seat + foot + 0.06 < height:
                model.box((-half + leg, seat + foot, 0.01), (half - leg, seat + foot + 0.06, 0.03), frame)
    return model


def stool(style: Style) -> Model:
    """A round stool."""
    height = style.draws.uniform(0.42, 0.5)
    model = Model("stool", 0.36, 0.36, height)
    model.turned((0.0, 0.0, 0.18), [(0.0, 0.15), (0.03, 0.05), (height - 0.08, 0.05)], style.metal(), sides=8)
    model.turned((0.0, height - 0.08, 0.18), [(0.0, 0.15), (0.04, 0.18), (0.08, 0.16)], style.upholstery(), sides=10)
    return model
