"""Mip pyramids of all textures of a scene in one buffer, and trilinear lookup into them."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from deux.compilation import compiled
from deux.contracts import Material


class TexturePyramids(NamedTuple):
    """Textures and their halved copies (mip levels), packed.

    Args:
        texels: flat uint8: every level's rows x columns x 3, one after the other.
        offsets: T x L int64, index in `texels` of each texture's levels; -1 beyond the last.
        sizes: T x 2 int64, height and width of level 0; level l has max(1, size >> l).
        material_texture: M int64, the texture of each material, -1 for none.
    """

    texels: np.ndarray
    offsets: np.ndarray
    sizes: np.ndarray
    material_texture: np.ndarray


def pack_textures(materials: Sequence[Material]) -> TexturePyramids:
    """Build the pyramids of all textures of `materials`; a texture that several share is stored once."""
    textures: list[np.ndarray] = []
    index: dict[int, int] = {}
    material_texture = np.full(len(materials), -1, dtype=np.int64)
    for number, material in enumerate(materials):
        if material.texture is not None:
            if id(material.texture) not in index:
                index[id(material.texture)] = len(textures)
                textures.append(material.texture)
            material_texture[number] = index[id(material.texture)]

    sizes = np.array([texture.shape[:2] for texture in textures], dtype=np.int64).reshape(-1, 2)
    levels = [int(size.max()).bit_length() for size in sizes]
    offsets = np.full((len(textures), max(levels, default=1)), -1, dtype=np.int64)
    end = 0
    for number, count in enumerate(levels):
        for level in range(count):
            offsets[number, level] = end
            end += 3 * int(np.maximum(1, sizes[number] >> level).prod())

    texels = np.empty(end, dtype=np.uint8)
    for texture, starts, count in zip(textures, offsets, levels, strict=True):
        for level in range(count):
            if level > 0:
                height, width = texture.shape[:2]
                # Bilinear at half the size is the mean of 2 x 2 texels, and what OpenGL does where a size is odd.
                texture = cv2.resize(texture, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_LINEAR)
            texels[starts[level] : starts[level] + texture.size] = texture.reshape(-1)
    return TexturePyramids(texels, offsets, sizes, material_texture)


@compiled(nogil=True, error_model="numpy")
def bilinear_lookup(
    texels: np.ndarray, offset: int, height: int, width: int, s: float, t: float
) -> tuple[float, float, float]:
    """Colour (0 to 255) at texture coordinates (s, t) in one level that starts at `offset`, repeated, t up.

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
    """Colour (0 to 255) between the two levels of one texture's pyramid (`offsets`: L) around `level`."""
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
