"""Textures of walls and ceilings: plaster, wallpapers, brick, tiles, panels."""

import numpy as np

from deux_plugins.scenes.parts.canvas import Canvas, Color, scaled, smoothstep, triangle
from deux_plugins.scenes.parts.textures_floor import WOOD_TONES

WALL_TONES: tuple[Color, ...] = (
    (216, 208, 192), (190, 206, 198), (212, 192, 178), (182, 196, 212), (224, 206, 168), (204, 190, 208),
    (180, 194, 162), (216, 182, 162), (196, 196, 200), (168, 186, 190), (222, 214, 204), (196, 172, 150),
)  # fmt: skip
ACCENT_TONES: tuple[Color, ...] = (
    (120, 70, 62), (70, 92, 120), (84, 108, 82), (150, 116, 66), (110, 84, 112), (60, 104, 108), (168, 96, 72),
)  # fmt: skip


def plaster(canvas: Canvas) -> np.ndarray:
    """Trowelled plaster: patches of all sizes, strokes and fine cracks."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES))
    strokes = canvas.streaks(24, 8) * canvas.mottle(4, 8) * 0.1 + canvas.streaks(10, 28) * 0.07
    t = 0.64 + canvas.mottle(4, 64, 0.95) * 0.17 + strokes - canvas.veins(4, 16, 8.0) * 0.22
    return canvas.blend(scaled(tone, 0.6), scaled(tone, 1.14), t)


def striped_wallpaper(canvas: Canvas) -> np.ndarray:
    """Vertical stripes in two widths with sprigs between them."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES))
    accent = canvas.tint(canvas.draws.choice(ACCENT_TONES))
    count = canvas.draws.choice((8, 10, 16))
    phase = canvas.x * np.float32(count / canvas.size)
    stripe = smoothstep(np.clip((triangle(phase) - 0.5) * 2.5 + 0.3, 0.0, 1.0))
    line = smoothstep(np.clip((triangle(phase + 0.5) - 0.82) * 8.0, 0.0, 1.0))
    sprigs = np.clip(_flowers(canvas, count * 2, count, 3) * 1.2, 0.0, 1.0) * (1.0 - stripe)
    ground = canvas.blend(scaled(tone, 0.74), scaled(tone, 1.14), 0.55 + canvas.mottle(4, 64, 0.8) * 0.24)
    image = ground * (1.0 - 0.22 * stripe)
    return canvas.blend(image, accent, (line * 0.55 + sprigs * 0.6) * (0.75 + canvas.mottle(8, 32) * 0.2))


def flowered_wallpaper(canvas: Canvas) -> np.ndarray:
    """Blossoms of random sizes on a staggered lattice."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES))
    accent = canvas.tint(canvas.draws.choice(ACCENT_TONES))
    second = canvas.tint(canvas.draws.choice(ACCENT_TONES))
    count = canvas.draws.choice((6, 8, 10))
    large = _flowers(canvas, count, count, canvas.draws.choice((5, 6, 8)))
    small = np.roll(_flowers(canvas, count * 2, count * 2, 4), canvas.size // 5, axis=(0, 1))
    ground = canvas.blend(scaled(tone, 0.72), scaled(tone, 1.12), 0.55 + canvas.mottle(4, 64, 0.8) * 0.25)
    image = canvas.blend(ground, second, small * (0.4 + canvas.mottle(4, 16) * 0.12))
    return canvas.blend(image, accent, large * (0.6 + canvas.mottle(8, 64) * 0.2))


def geometric_wallpaper(canvas: Canvas) -> np.ndarray:
    """Lozenges, rings or zigzags."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES))
    accent = canvas.tint(canvas.draws.choice(ACCENT_TONES))
    count = canvas.draws.choice((6, 8, 10))
    row, column, vertical, horizontal = canvas.cells(count, count, stagger=True)
    kind = canvas.draws.integer(0, 2)
    if kind == 0:
        wave = triangle((np.abs(vertical) + np.abs(horizontal)) * 1.0)
    elif kind == 1:
        wave = triangle(np.sqrt(vertical * vertical + horizontal * horizontal) * 1.25)
    else:
        phase = canvas.x * np.float32(count / canvas.size)
        wave = triangle(canvas.y * np.float32(count * 2 / canvas.size) + np.abs(2.0 * (phase - np.floor(phase)) - 1.0))
    mask = smoothstep(np.clip(wave * 2.4 - 0.9, 0.0, 1.0))
    strength = 0.45 + canvas.draws.field(count, count)[row, column] * 0.2 + canvas.mottle(8, 64) * 0.14
    ground = canvas.blend(scaled(tone, 0.72), scaled(tone, 1.12), 0.55 + canvas.mottle(4, 64, 0.8) * 0.26)
    return canvas.blend(ground, accent, mask * strength)


def brick(canvas: Canvas) -> np.ndarray:
    """A brick bond with mortar."""
    tone = canvas.tint(canvas.draws.choice(((176, 98, 76), (188, 140, 112), (206, 196, 182), (150, 120, 108))), 16)
    rows, columns = canvas.draws.choice(((32, 10), (28, 9), (24, 8)))
    row, column, _, _ = canvas.cells(rows, columns, stagger=True)
    shade = canvas.draws.field(rows, columns)[row, column]
    t = 0.5 + shade * 0.26 + canvas.mottle(16, 128, 0.8) * 0.15 + canvas.mottle(4, 8) * 0.08
    bricks = canvas.blend(scaled(tone, 0.45), scaled(tone, 1.3), t)
    mortar = canvas.blend((120, 114, 106), (206, 198, 186), 0.5 + canvas.mottle(8, 64) * 0.25)
    return canvas.blend(mortar, bricks, canvas.joints(rows, columns, stagger=True, width=2.5))


def wall_tiles(canvas: Canvas) -> np.ndarray:
    """Glazed tiles, a few of them in an accent colour."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES))
    accent = canvas.tint(canvas.draws.choice(ACCENT_TONES))
    rows, columns, stagger = canvas.draws.choice(((16, 16, False), (20, 10, True), (12, 12, False), (24, 12, True)))
    row, column, _, _ = canvas.cells(rows, columns, stagger)
    accented = (canvas.draws.field(rows, columns) > 0.6).astype(np.float32)[row, column]
    shade = canvas.draws.field(rows, columns)[row, column]
    t = 0.6 + shade * 0.2 + canvas.mottle(4, 64) * 0.16
    image = canvas.blend(scaled(tone, 0.62), scaled(tone, 1.12), t)
    image = canvas.blend(image, canvas.blend(scaled(accent, 0.7), scaled(accent, 1.5), t), accented * 0.8)
    return image * (0.62 + 0.38 * canvas.joints(rows, columns, stagger, width=2.0))


def panelling(canvas: Canvas) -> np.ndarray:
    """Upright boards, painted or bare, with grooves."""
    tone = canvas.tint(canvas.draws.choice(WOOD_TONES + WALL_TONES))
    columns = canvas.draws.choice((16, 20, 24))
    _, column, _, _ = canvas.cells(1, columns)
    shade = canvas.draws.field(columns)[column]
    fibres = canvas.streaks(8, 96) * 0.12 + canvas.streaks(3, 40) * 0.1
    t = 0.55 + shade * 0.16 + fibres + canvas.mottle(4, 32) * 0.12
    return canvas.blend(scaled(tone, 0.5), scaled(tone, 1.15), t * (0.4 + 0.6 * canvas.joints(1, columns, width=2.0)))


def ceiling_panels(canvas: Canvas) -> np.ndarray:
    """Square pressed panels with a raised rim and a rosette."""
    tone = canvas.tint((216, 212, 204))
    count = canvas.draws.choice((4, 5, 6))
    row, column, vertical, horizontal = canvas.cells(count, count)
    shade = canvas.draws.field(count, count)[row, column]
    rim = triangle(np.maximum(np.abs(vertical), np.abs(horizontal)) * 1.5)
    rosette = _flowers(canvas, count, count, 8, stagger=False)
    t = 0.55 + shade * 0.1 + (rim - 0.5) * 0.2 - rosette * 0.3 + canvas.mottle(8, 64, 0.95) * 0.14
    return canvas.blend(scaled(tone, 0.58), scaled(tone, 1.15), t * (0.6 + 0.4 * canvas.joints(count, count)))


def _flowers(canvas: Canvas, rows: int, columns: int, petals: int, stagger: bool = True) -> np.ndarray:
    """One blossom in each cell, with radius 0.55 + 0.22 cos(petals x angle), computed as the real part of a power."""
    row, column, vertical, horizontal = canvas.cells(rows, columns, stagger)
    real, imaginary = horizontal, vertical
    for _ in range(petals - 1):
        real, imaginary = real * horizontal - imaginary * vertical, real * vertical + imaginary * horizontal
    radius = np.sqrt(horizontal * horizontal + vertical * vertical)
    wave = real / np.maximum(np.sqrt(real * real + imaginary * imaginary), 1e-6)
    size = 1.0 + canvas.draws.field(rows, columns)[row, column] * 0.2
    outer = smoothstep(np.clip(((0.55 + 0.22 * wave) * size - radius) * 5.0, 0.0, 1.0))
    return outer * (0.5 + 0.5 * smoothstep(np.clip(np.abs(radius - 0.22) * 6.0, 0.0, 1.0)))
