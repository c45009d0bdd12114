"""The common output of the readers of mesh files: parts with one material each."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deux.contracts import Material
from deux.errors import DeuxError

GREY = (160, 160, 160)
"""Base colour of surfaces without a colour in their file."""


@dataclass(frozen=True)
class MeshPart:
    """Triangles with one material, with the transforms of the file's nodes applied.

    Args:
        vertices: V x 3 float64, in the axes and units of the file; parts may share an array of which each uses a part.
        faces: F x 3 int64, indices into `vertices`.
        material: the material; parts with the same texture share its array.
        uv: F x 3 x 2 float32, texture coordinates of each corner, (0, 0) at the bottom left; None without a texture.
        vertex_colors: V x 3 uint8, multiplied with the material; None without vertex colours.
    """

    vertices: np.ndarray
    faces: np.ndarray
    material: Material
    uv: np.ndarray | None = None
    vertex_colors: np.ndarray | None = None


def check_indices(faces: np.ndarray, count: int, path: Path) -> None:
    """Check that faces refer to existing vertices.

    Args:
        faces: indices of vertices, of any shape.
        count: number of vertices.
        path: the file, for the message.

    Raises:
        DeuxError: a face refers to a vertex that does not exist.
    """
    if faces.size and (faces.min() < 0 or faces.max() >= count):
        wrong = int(faces.min()) if faces.min() < 0 else int(faces.max())
        raise DeuxError(f"{path} is damaged: a face uses vertex {wrong}, but there are {count} vertices.")
