"""Textures of furniture and small things: cloth, leather, metal, enamel, paint, foliage, cardboard, books."""

import numpy as np

from deux_plugins.scenes.parts.canvas import Canvas, Color, planes, scaled, smoothstep, triangle
from deux_plugins.scenes.parts.textures_wall import ACCENT_TONES, WALL_TONES

FABRIC_TONES: tuple[Color, ...] = (
    (150, 84, 76), (86, 108, 146), (112, 136, 100), (176, 144, 98), (124, 112, 142), (190, 172, 150), (84, 124, 128),
    (196, 124, 84), (110, 110, 118), (204, 190, 160),
)  # fmt: skip
PAINT_TONES: tuple[Color, ...] = (
    (222, 216, 204), (206, 212, 206), (150, 172, 160), (140, 160, 178), (214, 196, 160), (176, 120, 100),
    (120, 130, 128),
)  # fmt: skip


def weave(canvas: Canvas) -> np.ndarray:
    """Coarse cloth: threads going over and under, uneven dye."""
    tone = canvas.tint(canvas.draws.choice(FABRIC_TONES))
    threads = canvas.size // 8
    row, column, vertical, horizontal = canvas.cells(threads, threads)
    over = (row + column) % 2 == 0
    bulge = 1.0 - np.where(over, vertical * vertical, horizontal * horizontal)
    yarn = np.where(over, canvas.streaks(threads, 8), canvas.streaks(8, threads))
    t = 0.3 + bulge * 0.25 + yarn * 0.09 + canvas.mottle(4, 32, 0.85) * 0.2
    return canvas.blend(scaled(tone, 0.5), scaled(tone, 1.35), t)


def plaid(canvas: Canvas) -> np.ndarray:
    """Crossing bands of three colours."""
    tones = [canvas.tint(canvas.draws.choice(FABRIC_TONES)) for _ in range(3)]
    count = canvas.draws.choice((3, 4, 5))
    across, down = (triangle(axis * np.float32(count / canvas.size)) for axis in (canvas.x, canvas.y))
    wide = (np.clip(across * 4.0 - 1.4, 0.0, 1.0) + np.clip(down * 4.0 - 1.4, 0.0, 1.0)) * 0.5
    thin = np.maximum(np.clip(1.0 - across * 14.0, 0.0, 1.0), np.clip(1.0 - down * 14.0, 0.0, 1.0))
    ground = canvas.blend(scaled(tones[0], 0.6), scaled(tones[0], 1.3), 0.5 + canvas.mottle(4, 64, 0.85) * 0.22)
    image = canvas.blend(ground, scaled(tones[1], 0.75), wide * 0.8)
    return canvas.blend(image, scaled(tones[2], 1.4), thin * 0.7)


def linen(canvas: Canvas) -> np.ndarray:
    """Bed linen: light ground, printed dots, leaves or stripes, and creases."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES))
    accent = canvas.tint(canvas.draws.choice(ACCENT_TONES))
    count = canvas.draws.choice((6, 8, 10))
    row, column, vertical, horizontal = canvas.cells(count, count, stagger=True)
    slant = canvas.draws.field(count, count)[row, column]
    leaf = horizontal * horizontal * 5.0 + (vertical - horizontal * slant) * (vertical - horizontal * slant) * 1.8
    print_mask = smoothstep(np.clip((1.0 - leaf) * 2.0, 0.0, 1.0))
    creases = canvas.veins(4, 16, 2.0) * 0.25
    ground = canvas.blend(scaled(tone, 0.66), scaled(tone, 1.16), 0.68 + canvas.mottle(4, 64) * 0.16 - creases)
    return canvas.blend(ground, accent, print_mask * (0.6 + canvas.mottle(8, 32) * 0.15))


def leather(canvas: Canvas) -> np.ndarray:
    """Worn leather with a net of folds."""
    tone = canvas.tint(
        canvas.draws.choice(((122, 78, 54), (92, 88, 92), (160, 116, 80), (110, 58, 50), (190, 174, 150)))
    )
    folds = canvas.veins(16, 64, 1.6) * 0.3 + canvas.veins(8, 16, 3.0) * 0.18
    t = 0.62 + canvas.mottle(4, 32, 0.85) * 0.2 - folds
    return canvas.blend(scaled(tone, 0.42), scaled(tone, 1.45), t)


def brushed_metal(canvas: Canvas) -> np.ndarray:
    """Brushed metal with stains and fingerprints."""
    tone = canvas.tint(canvas.draws.choice(((176, 180, 184), (150, 152, 158), (190, 180, 164), (120, 124, 130))))
    t = 0.5 + canvas.streaks(64, 4) * 0.14 + canvas.streaks(16, 2) * 0.12 + canvas.mottle(4, 32, 0.85) * 0.16
    return canvas.blend(scaled(tone, 0.5), scaled(tone, 1.3), t)


def enamel(canvas: Canvas) -> np.ndarray:
    """Speckled enamel and glazed ceramics with a slightly clouded ground."""
    tone = canvas.tint((218, 216, 208))
    speckles = np.clip((canvas.mottle(32, 64) - 1.2) * 2.0, 0.0, 1.0) * 0.5
    t = 0.72 + canvas.mottle(2, 32, 0.85) * 0.17 - canvas.veins(4, 16, 5.0) * 0.25
    image = canvas.blend(scaled(tone, 0.56), scaled(tone, 1.12), t)
    return canvas.blend(image, canvas.draws.choice(ACCENT_TONES), speckles)


def paint(canvas: Canvas) -> np.ndarray:
    """Old painted wood: brush strokes along u, and places where the wood shows through."""
    tone = canvas.tint(canvas.draws.choice(PAINT_TONES))
    strokes = canvas.streaks(48, 5) * 0.1 + canvas.streaks(16, 3) * 0.1
    ground = canvas.blend(scaled(tone, 0.62), scaled(tone, 1.18), 0.58 + strokes + canvas.mottle(4, 32) * 0.14)
    worn = np.clip((canvas.mottle(8, 64, 0.9) - 1.25) * 3.0, 0.0, 1.0)
    return canvas.blend(ground, canvas.tint((124, 88, 60)), worn * 0.8)


def foliage(canvas: Canvas) -> np.ndarray:
    """Overlapping leaves with midribs, light on dark."""
    tone = canvas.tint(canvas.draws.choice(((96, 146, 70), (118, 150, 84), (76, 128, 82), (140, 152, 70))))
    image = canvas.blend(scaled(tone, 0.25), scaled(tone, 0.6), 0.5 + canvas.mottle(4, 32) * 0.3)
    for count, shift in ((8, 0), (10, 7), (12, 3)):
        row, column, vertical, horizontal = canvas.cells(count, count, stagger=True)
        slant = canvas.draws.field(count, count)[row, column] * 1.6
        offset = horizontal - vertical * slant
        leaf = np.clip((1.0 - offset * offset * 7.0 - vertical * vertical * 1.3) * 3.0, 0.0, 1.0)
        rib = np.clip(1.0 - np.abs(offset) * 10.0, 0.0, 1.0)
        shade = 0.9 + canvas.draws.field(count, count)[row, column] * 0.45
        color = np.roll(planes(tone) * (shade + rib * 0.3), shift * 4, axis=(1, 2))
        image = canvas.blend(image, color, np.roll(leaf, shift * 4, axis=(0, 1)))
    return image


def cardboard(canvas: Canvas) -> np.ndarray:
    """Cardboard with printing and tape."""
    tone = canvas.tint((190, 150, 108))
    image = canvas.blend(scaled(tone, 0.6), scaled(tone, 1.2), 0.55 + canvas.mottle(4, 64, 0.85) * 0.18)
    row, column, vertical, horizontal = canvas.cells(8, 4, stagger=True)
    printed = (canvas.draws.field(8, 4) > 0.3).astype(np.float32)[row, column]
    mark = np.clip((0.7 - np.maximum(np.abs(vertical) * 1.6, np.abs(horizontal))) * 8.0, 0.0, 1.0)
    return canvas.blend(image, canvas.draws.choice(ACCENT_TONES), mark * printed * 0.75)


def book_spines(canvas: Canvas) -> np.ndarray:
    """A row of spines side by side, with bands and titles; v spans one shelf."""
    image = np.zeros((3, canvas.size, canvas.size), dtype=np.float32)
    height = canvas.y / np.float32(canvas.size)
    start = 0
    while start < canvas.size:
        width = canvas.draws.integer(8, 19)
        width = canvas.size - start if canvas.size - start < width + 8 else width
        cloth = canvas.tint(canvas.draws.choice(FABRIC_TONES + ACCENT_TONES + WALL_TONES), 24)
        ink = canvas.tint(canvas.draws.choice(((232, 214, 160), (240, 236, 226), (40, 36, 34))))
        edge = np.abs((np.arange(width, dtype=np.float32) + 0.5) / np.float32(width) * 2.0 - 1.0)[None, :]
        round_back = 1.0 - edge * edge * edge * edge * 0.55
        centre, half = canvas.draws.uniform(0.25, 0.6), canvas.draws.uniform(0.06, 0.16)
        title = np.clip((half - np.abs(height - centre)) * 30.0, 0.0, 1.0) * np.clip((0.55 - edge) * 4.0, 0.0, 1.0)
        place = canvas.draws.uniform(0.75, 0.92)
        band = np.clip((0.025 - np.abs(height - place)) * 60.0, 0.0, 1.0)
        spine = canvas.blend(cloth, ink, np.maximum(title, band * np.ones_like(edge)) * 0.85)
        image[:, :, start : start + width] = spine * round_back
        start += width
    return image * (1.0 + canvas.mottle(4, 64) * 0.09)
