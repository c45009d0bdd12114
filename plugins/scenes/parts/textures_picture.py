"""Textures that are stretched over a whole face: paintings, views through windows, rugs."""

import numpy as np

from deux_plugins.scenes.parts.canvas import Canvas, Color, scaled, smoothstep, triangle
from deux_plugins.scenes.parts.textures_object import FABRIC_TONES
from deux_plugins.scenes.parts.textures_wall import ACCENT_TONES, WALL_TONES

SKIES: tuple[tuple[Color, Color], ...] = (
    ((120, 160, 206), (214, 222, 224)), ((150, 140, 170), (238, 206, 170)), ((160, 176, 190), (220, 220, 214)),
)  # fmt: skip
LANDS: tuple[Color, ...] = ((120, 142, 110), (146, 140, 96), (104, 122, 118), (160, 126, 92), (92, 116, 80))


def landscape(canvas: Canvas) -> np.ndarray:
    """Hills one behind the other under a clouded sky."""
    image = _sky(canvas)
    base, land = canvas.draws.uniform(0.35, 0.5), canvas.draws.choice(LANDS)
    for layer in range(4):
        ridge = base + layer * 0.15 + _silhouette(canvas, 4) * 0.05 + _silhouette(canvas, 16) * 0.015
        ground = canvas.blend(
            scaled(land, 0.45), scaled(land, 1.35), 0.5 + canvas.mottle(8, 64, 0.85) * 0.25 + layer * 0.04
        )
        height = canvas.y / np.float32(canvas.size)
        image = canvas.blend(image, ground, (height - ridge) * 60.0)
        land = canvas.tint(canvas.draws.choice(LANDS))
    return image


def city_view(canvas: Canvas) -> np.ndarray:
    """Houses with rows of windows behind trees."""
    image = _sky(canvas)
    for _ in range(11):
        left, width = canvas.draws.integer(0, canvas.size - 20), canvas.draws.integer(24, 60)
        top = canvas.draws.integer(canvas.size // 5, canvas.size * 3 // 5)
        wall = canvas.tint(canvas.draws.choice(WALL_TONES + ACCENT_TONES), 20)
        across, down = canvas.x - np.float32(left), canvas.y - np.float32(top)
        inside = np.clip(np.minimum(across, width - across), 0.0, 1.0) * np.clip(down, 0.0, 1.0)
        panes = np.clip((triangle(across / 12.0) - 0.5) * 4.0, 0.0, 1.0) * np.clip(
            (triangle(down / 16.0) - 0.5) * 4.0, 0.0, 1.0
        )
        image = canvas.blend(image, canvas.blend(scaled(wall, 0.85), (58, 66, 78), panes), inside)
    trees = 0.72 + _silhouette(canvas, 8) * 0.06 + _silhouette(canvas, 32) * 0.025
    leaves = canvas.blend((38, 58, 34), (140, 164, 92), 0.45 + canvas.mottle(16, 64, 0.9) * 0.28)
    image = canvas.blend(image, leaves, (canvas.y / np.float32(canvas.size) - trees) * 50.0)
    return image * (1.0 + canvas.mottle(4, 32) * 0.05)


def abstract(canvas: Canvas) -> np.ndarray:
    """Discs, bars and rings of paint on a brushed ground."""
    tones = WALL_TONES + ACCENT_TONES + FABRIC_TONES
    ground = canvas.tint(canvas.draws.choice(WALL_TONES))
    image = canvas.blend(scaled(ground, 0.6), scaled(ground, 1.15), 0.55 + canvas.streaks(12, 40) * 0.2)
    strength = 0.85 + canvas.mottle(8, 32) * 0.12
    for _ in range(canvas.draws.integer(9, 15)):
        x, y = (canvas.draws.uniform(0.05, 0.95) * canvas.size for _ in range(2))
        radius = canvas.draws.uniform(0.06, 0.24) * canvas.size
        slope = canvas.draws.uniform(-1.0, 1.0)
        across, down = canvas.x - x + (canvas.y - y) * slope, canvas.y - y
        kind = canvas.draws.integer(0, 2)
        round_distance = np.sqrt((canvas.x - x) * (canvas.x - x) + down * down)
        distance = (
            np.maximum(np.abs(across), np.abs(down) * canvas.draws.uniform(0.4, 2.5)),
            round_distance,
            np.abs(round_distance - radius * 0.7) * 3.0,
        )[kind]
        color = canvas.tint(canvas.draws.choice(tones), 24)
        image = canvas.blend(image, color, smoothstep(np.clip((radius - distance) / 3.0, 0.0, 1.0)) * strength)
    return image


def still_life(canvas: Canvas) -> np.ndarray:
    """Large blossoms before a dark ground."""
    ground = scaled(canvas.draws.choice(ACCENT_TONES), 0.7)
    image = canvas.blend(scaled(ground, 0.5), scaled(ground, 1.5), 0.5 + canvas.mottle(2, 32) * 0.28)
    for _ in range(canvas.draws.integer(7, 11)):
        x, y = (canvas.draws.uniform(0.12, 0.88) * canvas.size for _ in range(2))
        radius = canvas.draws.uniform(0.09, 0.2) * canvas.size
        p, q = (canvas.x - x) / radius, (canvas.y - y) / radius
        distance = np.sqrt(p * p + q * q)
        real, imaginary = p, q
        for _ in range(4):
            real, imaginary = real * p - imaginary * q, real * q + imaginary * p
        wave = real / np.maximum(np.sqrt(real * real + imaginary * imaginary), 1e-6)
        petals = smoothstep(np.clip((0.8 + 0.2 * wave - distance) * 8.0, 0.0, 1.0))
        tone = canvas.tint(canvas.draws.choice(WALL_TONES + FABRIC_TONES), 24)
        color = canvas.blend(scaled(tone, 0.55), scaled(tone, 1.3), distance * 0.9 + wave * 0.25)
        heart = np.clip((0.25 - distance) * 8.0, 0.0, 1.0)
        image = canvas.blend(canvas.blend(image, color, petals), (214, 170, 60), heart)
    return image


def rug(canvas: Canvas) -> np.ndarray:
    """A knotted rug: borders, a field of lozenges and a medallion."""
    tones = [canvas.tint(canvas.draws.choice(FABRIC_TONES + ACCENT_TONES), 20) for _ in range(4)]
    p = canvas.x / np.float32(canvas.size / 2) - 1.0
    q = canvas.y / np.float32(canvas.size / 2) - 1.0
    rim = np.maximum(np.abs(p), np.abs(q))
    count = canvas.draws.choice((8, 10, 12))
    row, column, vertical, horizontal = canvas.cells(count, count, stagger=True)
    lozenge = np.clip((0.7 - np.abs(vertical) - np.abs(horizontal)) * 6.0, 0.0, 1.0)
    shade = canvas.draws.field(count, count)[row, column] * 0.25
    image = canvas.blend(scaled(tones[0], 0.8), tones[1], lozenge * (0.7 + shade))
    centre = np.sqrt(p * p + q * q) if canvas.draws.chance(0.5) else np.abs(p) + np.abs(q)
    rings = smoothstep(np.clip(triangle(centre * canvas.draws.choice((4.0, 5.0, 6.0))) * 3.0 - 1.0, 0.0, 1.0))
    medallion = canvas.blend(tones[2], scaled(tones[3], 1.3), rings)
    image = canvas.blend(image, medallion, (0.52 - centre) * 40.0)
    teeth = triangle((p + q) * 8.0) * triangle((p - q) * 8.0)
    image = canvas.blend(image, canvas.blend(tones[3], scaled(tones[2], 1.4), teeth * 2.0), (rim - 0.74) * 60.0)
    image = canvas.blend(image, scaled(tones[0], 0.5), (rim - 0.93) * 60.0)
    return image * (1.0 + canvas.mottle(4, 64, 0.95) * 0.16)


def _sky(canvas: Canvas) -> np.ndarray:
    high, low = canvas.draws.choice(SKIES)
    height = np.broadcast_to(canvas.y / np.float32(canvas.size * 0.6), (canvas.size, canvas.size))
    clouds = np.clip(canvas.mottle(4, 32, 0.7) * 0.7, 0.0, 0.8)
    return canvas.blend(canvas.blend(high, low, height), (244, 242, 238), clouds)


def _silhouette(canvas: Canvas, cells: int) -> np.ndarray:
    """Heights of a random line over x, 1 x size, with unit deviation."""
    return canvas.streaks(1, cells)[:1]
