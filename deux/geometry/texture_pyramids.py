"""Mip pyramids: textures and their halved copies, packed into one buffer.

L. Williams, "Pyramidal Parametrics", SIGGRAPH 1983.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import cv2
import numpy as np


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

    def texture(self, number: int) -> np.ndarray:
        """Level 0 of a texture, height x width x 3, not copied."""
        height, width = self.sizes[number]
        start = self.offsets[number, 0]
        return self.texels[start : start + 3 * height * width].reshape(height, width, 3)


def pack_pyramids(textures: list[np.ndarray], material_texture: Sequence[int]) -> TexturePyramids:
    """Build the pyramids of textures. The list is emptied on the way, so that no texture is in memory twice for long.

    Args:
        textures: height x width x 3 uint8 each.
        material_texture: the texture of each material, -1 for none.
    """
    sizes = np.array([texture.shape[:2] for texture in textures], dtype=np.int64).reshape(-1, 2)
    levels = [int(size.max()).bit_length() for size in sizes]
    offsets = np.full((len(textures), max(levels, default=1)), -1, dtype=np.int64)
    end = 0
    for number, count in enumerate(levels):
        for level in range(count):
            offsets[number, level] = end
            end += 3 * int(np.maximum(1, sizes[number] >> level).prod())

    texels = np.empty(end, dtype=np.uint8)

    def fill(number: int, texture: np.ndarray) -> None:
        _fill_levels(texture, texels, offsets[number, : levels[number]])

    # Each texture is taken from the list here: threads that took them themselves might do so in another order.
    numbers = reversed(range(len(levels)))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(fill, numbers, (textures.pop() for _ in levels)))
    return TexturePyramids(texels, offsets, sizes, np.array(material_texture, dtype=np.int64))


def _fill_levels(texture: np.ndarray, texels: np.ndarray, starts: np.ndarray) -> None:
    """Write a texture and its halved copies to where they begin in `texels`."""
    for level, start in enumerate(starts):
        if level > 0:
            height, width = texture.shape[:2]
            # Bilinear at half the size is the mean of 2 x 2 texels, and what OpenGL does where a size is odd.
            texture = cv2.resize(texture, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_LINEAR)
        texels[start : start + texture.size] = texture.reshape(-1)
