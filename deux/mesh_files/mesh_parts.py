"""What the readers of mesh files have in common: the parts of which a file's geometry consists."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.contracts import Material
from deux.errors import DeuxError

GREY = (160, 160, 160)
"""Base colour of surfaces whose file says nothing of their colour."""


@dataclass(frozen=True)
class MeshPart:
    """Triangles of one material, as their file describes them, with the transforms of its nodes applied.

    Args:
        vertices: V x 3 float64, in the axes and units of the file; parts may share one array, of which each uses some.
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


def check_indices(faces: np.ndarray, count: int, path: Path) -> None:
    """Check that faces use the vertices that there are.

    Args:
        faces: indices of vertices, of any shape.
        count: the number of vertices.
        path: the file, for the message.

    Raises:
        DeuxError: a face uses another one.
    """
    if faces.size and (faces.min() < 0 or faces.max() >= count):
        wrong = int(faces.min()) if faces.min() < 0 else int(faces.max())
        raise DeuxError(f"{path} is damaged: a face uses vertex {wrong}, but there are {count} vertices.")
