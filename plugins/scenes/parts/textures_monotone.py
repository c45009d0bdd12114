"""Textures that are difficult for depth models: nearly uniform ones, and ones that repeat exactly."""

import numpy as np

from deux_plugins.scenes.parts.canvas import Canvas, scaled, smoothstep, triangle
from deux_plugins.scenes.parts.textures_floor import STONE_TONES
from deux_plugins.scenes.parts.textures_wall import ACCENT_TONES, WALL_TONES


def distemper(canvas: Canvas) -> np.ndarray:
    """Evenly painted wall: clouds of one to three of 255 levels."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES), 20)
    strength = canvas.draws.uniform(0.02, 0.06)
    return canvas.blend(scaled(tone, 0.8), scaled(tone, 1.08), 0.6 + canvas.mottle(2, 64, 0.85) * strength)


def linoleum(canvas: Canvas) -> np.ndarray:
    """Floor of one colour with faint marbling."""
    tone = canvas.tint(canvas.draws.choice(STONE_TONES), 20)
    strength = canvas.draws.uniform(0.03, 0.08)
    return canvas.blend(scaled(tone, 0.55), scaled(tone, 1.05), 0.5 + canvas.mottle(4, 64, 0.85) * strength)


def screed(canvas: Canvas) -> np.ndarray:
    """Bare concrete with soft stains."""
    tone = canvas.tint(canvas.draws.choice(((168, 166, 160), (148, 148, 146), (178, 170, 158))), 8)
    t = 0.55 + canvas.mottle(2, 64, 0.7) * 0.1 - canvas.veins(2, 8, 12.0) * 0.08
    return canvas.blend(scaled(tone, 0.6), scaled(tone, 1.15), t)


def damask(canvas: Canvas) -> np.ndarray:
    """Wallpaper with identical ornaments on a staggered lattice."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES))
    accent = canvas.tint(canvas.draws.choice(ACCENT_TONES))
    count = canvas.draws.choice((6, 8, 12))
    _, _, vertical, horizontal = canvas.cells(count, count, stagger=True)
    radius = np.sqrt(horizontal * horizontal + vertical * vertical * 0.6)
    leaf = smoothstep(np.clip((0.75 - radius - np.abs(horizontal) * 0.35) * 5.0, 0.0, 1.0))
    ring = smoothstep(np.clip(1.0 - np.abs(radius - 0.32) * 9.0, 0.0, 1.0))
    ground = canvas.blend(scaled(tone, 0.8), scaled(tone, 1.1), 0.6 + canvas.mottle(2, 16) * 0.03)
    return canvas.blend(ground, accent, np.maximum(leaf * (1.0 - ring), 0.0) * canvas.draws.uniform(0.35, 0.7))


def mosaic(canvas: Canvas) -> np.ndarray:
    """Small identical tiles in two alternating colours."""
    tone = canvas.tint(canvas.draws.choice(WALL_TONES + STONE_TONES))
    accent = canvas.tint(canvas.draws.choice(ACCENT_TONES + STONE_TONES))
    count = canvas.draws.choice((16, 24, 32))
    row, column, _, _ = canvas.cells(count, count)
    other = ((row + column) % 2 == 1).astype(np.float32) * canvas.draws.uniform(0.15, 0.7)
    ground = canvas.blend(scaled(tone, 0.8), scaled(tone, 1.1), 0.6 + canvas.mottle(2, 16) * 0.03)
    return canvas.blend(ground, accent, other) * (0.72 + 0.28 * canvas.joints(count, count, width=2.0))


def chequers(canvas: Canvas) -> np.ndarray:
    """Identical floor tiles in a chessboard pattern."""
    tone = canvas.tint(canvas.draws.choice(STONE_TONES))
    count = canvas.draws.choice((6, 8, 12))
    row, column, _, _ = canvas.cells(count, count)
    dark = ((row + column) % 2 == 1).astype(np.float32) * canvas.draws.uniform(0.25, 0.6)
    ground = canvas.blend(scaled(tone, 0.8), scaled(tone, 1.1), 0.6 + canvas.mottle(2, 32) * 0.03)
    return ground * (1.0 - dark) * (0.8 + 0.2 * canvas.joints(count, count, width=2.0))


def ceiling_grid(canvas: Canvas) -> np.ndarray:
    """Even ceiling boards in a grid of rails."""
    tone = canvas.tint((222, 220, 214), 6)
    count = canvas.draws.choice((4, 5))
    shade = triangle(canvas.x * np.float32(count / canvas.size)) * 0.02
    ground = canvas.blend(scaled(tone, 0.8), scaled(tone, 1.08), 0.6 + canvas.mottle(4, 64) * 0.03 + shade)
    return ground * (0.75 + 0.25 * canvas.joints(count, count, width=3.0))
