"""What the readers of mesh files have in common: the parts of which a file's geometry consists."""

from dataclasses import dataclass

import numpy as np

from deux.contracts import Material

GREY = (160, 160, 160)
"""Colour of surfaces whose file says nothing of it."""


@dataclass(frozen=True)
class MeshPart:
    """Triangles of one material, as their file describes them, with the transforms of its nodes applied.

    Args:
        vertices: V x 3 float64, in the axes and units of the file.
        faces: F x 3 int64, indices into `vertices`.
        material: their appearance; parts that show one image share its array.
        uv: F x 3 x 2 float32, texture coordinates of each corner, (0, 0) at the bottom left; None without a texture.
        vertex_colors: V x 3 uint8, multiplied onto the material; None where there are none.
    """

    vertices: np.ndarray
    faces: np.ndarray
    material: Material
    uv: np.ndarray | None = None
    vertex_colors: np.ndarray | None = None
