"""Textures of floors, and of other surfaces of wood, tiles, stone and carpet."""

import numpy as np

from deux_plugins.scenes.parts.canvas import Canvas, Color, scaled, smoothstep, triangle

WOOD_TONES: tuple[Color, ...] = (
    (196, 148, 100), (158, 108, 70), (216, 182, 136), (128, 88, 60), (204, 166, 122), (178, 122, 84), (172, 160, 142),
)  # fmt: skip
STONE_TONES: tuple[Color, ...] = (
    (206, 200, 190), (176, 178, 180), (216, 196, 168), (150, 156, 160), (190, 170, 160), (168, 184, 180),
)  # fmt: skip
CARPET_TONES: tuple[Color, ...] = (
    (150, 120, 100), (110, 120, 140), (140, 140, 120), (150, 100, 96), (176, 160, 140), (104, 128, 118),
)  # fmt: skip


def wood(canvas: Canvas) -> np.ndarray:
    """Boards with rings and fibres running along u."""
    tone = canvas.tint(canvas.draws.choice(WOOD_TONES))
    rings = triangle(canvas.y * np.float32(7 / canvas.size) + canvas.streaks(6, 2) * 0.5 + canvas.streaks(12, 5) * 0.12)
    t = 0.45 + (rings - 0.5) * 0.45 + canvas.streaks(64, 6) * 0.11 + canvas.mottle(8, 32) * 0.12
    return canvas.blend(scaled(tone, 0.5), scaled(tone, 1.2), t)


def planks(canvas: Canvas) -> np.ndarray:
    """A floor of boards along u, each with its own shade and fibres."""
    tone = canvas.tint(canvas.draws.choice(WOOD_TONES))
    rows, per_row = canvas.draws.choice(((16, 2), (12, 3), (20, 2)))
    offsets = np.floor((canvas.draws.field(rows) + 1.0) * np.float32(canvas.size / 2)).astype(np.int64)
    row = np.floor(canvas.y * np.float32(rows / canvas.size)).astype(np.int64)
    along = (canvas.x.astype(np.int64) + offsets[row]) % canvas.size
    place = along.astype(np.float32) * np.float32(per_row / canvas.size)
    plank = np.floor(place).astype(np.int64)
    shade = canvas.draws.field(rows, per_row)[row, plank]
    shift = ((canvas.draws.field(rows, per_row) + 1.0) * 250.0).astype(np.int64)[row, plank]
    fibres = canvas.streaks(96, 10) * 0.6 + canvas.streaks(32, 4) * 0.8
    fibres = fibres[canvas.y.astype(np.int64), (along + shift) % canvas.size]
    across = canvas.y * np.float32(rows / canvas.size) - row.astype(np.float32)
    to_side = np.minimum(across, 1.0 - across) * np.float32(canvas.size / rows)
    to_end = np.minimum(place - plank, 1.0 - (place - plank)) * np.float32(canvas.size / per_row)
    gap = smoothstep(np.clip(np.minimum(to_side, to_end) / 2.0, 0.0, 1.0))
    t = (0.62 + shade * 0.26 + fibres * 0.15 + canvas.mottle(8, 32) * 0.07) * (0.35 + 0.65 * gap)
    return canvas.blend(scaled(tone, 0.46), scaled(tone, 1.25), t)


def parquet(canvas: Canvas) -> np.ndarray:
    """Squares of four strips, alternately along and across."""
    tone = canvas.tint(canvas.draws.choice(WOOD_TONES))
    count = canvas.draws.choice((6, 8))
    row, column, vertical, horizontal = canvas.cells(count, count)
    turned = (row + column) % 2 == 1
    across = (np.where(turned, horizontal, vertical) + 1.0) * 2.0
    strip = np.minimum(np.floor(across), 3.0).astype(np.int64)
    shade = canvas.draws.field(count, count, 4)[row, column, strip]
    to_side = np.minimum(across - strip, 1.0 - (across - strip)) * np.float32(canvas.size / count / 4)
    gap = np.clip(to_side / 2.0, 0.0, 1.0) * canvas.joints(count, count, width=1.0)
    along, crossing = canvas.streaks(96, 12), canvas.streaks(12, 96)
    fibres = np.where(turned, crossing, along)
    t = (0.62 + shade * 0.24 + fibres * 0.12 + canvas.mottle(8, 64) * 0.09) * (0.45 + 0.55 * gap)
    return canvas.blend(scaled(tone, 0.46), scaled(tone, 1.25), t)


def marble(canvas: Canvas) -> np.ndarray:
    """Polished stone with veins."""
    tone = canvas.tint(canvas.draws.choice(STONE_TONES))
    t = 0.66 + canvas.mottle(4, 64, 0.8) * 0.18 - canvas.veins(4, 32) * 0.4 - canvas.veins(8, 64, 5.0) * 0.2
    return canvas.blend(scaled(tone, 0.45), scaled(tone, 1.2), t)


def floor_tiles(canvas: Canvas) -> np.ndarray:
    """Square stone tiles with joints, sometimes in two colours like a chessboard."""
    tone = canvas.tint(canvas.draws.choice(STONE_TONES))
    other = scaled(canvas.draws.choice(WOOD_TONES + STONE_TONES), 0.62)
    count = canvas.draws.choice((6, 8, 10))
    row, column, _, _ = canvas.cells(count, count)
    checked = ((row + column) % 2 == 1) if canvas.draws.chance(0.5) else np.zeros(row.shape, dtype=bool)
    shade = canvas.draws.field(count, count)[row, column]
    t = 0.6 + shade * 0.14 + canvas.mottle(8, 64) * 0.14 - canvas.veins(8, 32) * 0.3
    first = canvas.blend(scaled(tone, 0.5), scaled(tone, 1.15), t)
    second = canvas.blend(scaled(other, 0.6), scaled(other, 1.4), t)
    return np.where(checked, second, first) * (0.55 + 0.45 * canvas.joints(count, count, width=2.0))


def terrazzo(canvas: Canvas) -> np.ndarray:
    """Chips of several stones in a light ground."""
    tone = canvas.tint(canvas.draws.choice(STONE_TONES))
    image = canvas.blend(scaled(tone, 0.75), scaled(tone, 1.15), 0.5 + canvas.mottle(4, 32) * 0.3)
    for cells in (128, 64, 64, 32):
        chips = np.clip((canvas.mottle(cells // 2, cells, 1.5) - 1.1) * 3.0, 0.0, 1.0)
        chip_tone = scaled(canvas.draws.choice(WOOD_TONES + STONE_TONES), canvas.draws.uniform(0.4, 0.9))
        image = canvas.blend(image, canvas.tint(chip_tone), chips)
    return image


def carpet(canvas: Canvas) -> np.ndarray:
    """Woollen floor with tufts and a faint lattice of lozenges."""
    tone = canvas.tint(canvas.draws.choice(CARPET_TONES))
    count = canvas.draws.choice((8, 12, 16))
    _, _, vertical, horizontal = canvas.cells(count, count)
    lozenge = triangle((np.abs(vertical) + np.abs(horizontal)) * 0.5)
    t = 0.5 + (lozenge - 0.5) * canvas.draws.uniform(0.2, 0.5) + canvas.mottle(4, 128, 0.9) * 0.2
    return canvas.blend(scaled(tone, 0.5), scaled(tone, 1.35), t)
