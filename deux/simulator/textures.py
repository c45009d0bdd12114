"""Mip pyramids of a scene's textures, and trilinear texture lookup."""

from collections.abc import Sequence

import numpy as np

from deux.compilation import compiled
from deux.contracts import Material
from deux.geometry.texture_pyramids import TexturePyramids, pack_pyramids


def pack_textures(materials: Sequence[Material]) -> TexturePyramids:
    """Build the mip pyramids of all textures of the materials; a shared texture is stored once."""
    textures: list[np.ndarray] = []
    index: dict[int, int] = {}
    material_texture = [-1] * len(materials)
    for number, material in enumerate(materials):
        if material.texture is not None:
            if id(material.texture) not in index:
                index[id(material.texture)] = len(textures)
                textures.append(material.texture)
            material_texture[number] = index[id(material.texture)]
    return pack_pyramids(textures, material_texture)


@compiled(nogil=True, error_model="numpy")
def bilinear_lookup(
    texels: np.ndarray, offset: int, height: int, width: int, s: float, t: float
) -> tuple[float, float, float]:
    """Colour (0 to 255) at texture coordinates (s, t) in one level that starts at `offset`; repeated, with t up.

    Texel (row, column) has its centre at s = (column + 0.5) / width, t = 1 - (row + 0.5) / height.
    """
    x = (s - np.floor(s)) * width - 0.5
    y = (np.ceil(t) - t) * height - 0.5
    column, row = int(np.floor(x)), int(np.floor(y))
    x -= column
    y -= row
    left = column if column >= 0 else width - 1
    right = column + 1 if column + 1 < width else 0
    above = row if row >= 0 else height - 1
    below = row + 1 if row + 1 < height else 0
    a = offset + 3 * (above * width + left)
    b = offset + 3 * (above * width + right)
    c = offset + 3 * (below * width + left)
    d = offset + 3 * (below * width + right)
    wa, wb, wc, wd = (1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y
    return (
        wa * texels[a] + wb * texels[b] + wc * texels[c] + wd * texels[d],
        wa * texels[a + 1] + wb * texels[b + 1] + wc * texels[c + 1] + wd * texels[d + 1],
        wa * texels[a + 2] + wb * texels[b + 2] + wc * texels[c + 2] + wd * texels[d + 2],
    )


@compiled(nogil=True, error_model="numpy")
def trilinear_lookup(
    texels: np.ndarray, offsets: np.ndarray, height: int, width: int, s: float, t: float, level: float
) -> tuple[float, float, float]:
    """Colour (0 to 255), interpolated between the two levels around `level`; `offsets` are those of the L levels."""
    last = 0
    while max(height, width) >> (last + 1) > 0:
        last += 1
    fine = int(min(max(level, 0.0), float(last)))
    blend = min(max(level, 0.0), float(last)) - fine
    red, green, blue = bilinear_lookup(texels, offsets[fine], max(1, height >> fine), max(1, width >> fine), s, t)
    if blend > 0.0:
        coarse = fine + 1
        r, g, b = bilinear_lookup(texels, offsets[coarse], max(1, height >> coarse), max(1, width >> coarse), s, t)
        red += blend * (r - red)
        green += blend * (g - green)
        blue += blend * (b - blue)
    return red, green, blue
