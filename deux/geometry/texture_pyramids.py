"""Mip pyramids: textures and their downsampled copies, packed into one buffer.

L. Williams, "Pyramidal Parametrics", SIGGRAPH 1983.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import cv2
import numpy as np


class TexturePyramids(NamedTuple):
    """Textures with their mip levels, packed into one buffer.

    Args:
        texels: flat uint8, the concatenated levels, each rows x columns x 3.
        offsets: T x L int64, index in `texels` of each texture's levels; -1 beyond the last.
        sizes: T x 2 int64, height and width of level 0; level l has max(1, size >> l).
        material_texture: M int64, texture index of each material, -1 for none.
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
    """Build the mip pyramids of textures. The list is emptied in the process to save memory.

    Args:
        textures: height x width x 3 uint8 each.
        material_texture: texture index of each material, -1 for none.
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

    # The textures are popped here, since the order in threads would be arbitrary.
    numbers = reversed(range(len(levels)))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(fill, numbers, (textures.pop() for _ in levels)))
    return TexturePyramids(texels, offsets, sizes, np.array(material_texture, dtype=np.int64))


def _fill_levels(texture: np.ndarray, texels: np.ndarray, starts: np.ndarray) -> None:
    """Write the levels of a texture to their start indices in `texels`."""
    for level, start in enumerate(starts):
        if level > 0:
            height, width = texture.shape[:2]
            # Bilinear resizing by one half is the mean of 2 x 2 texels, and equals OpenGL for odd sizes.
            texture = cv2.resize(texture, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_LINEAR)
        texels[start : start + texture.size] = texture.reshape(-1)
