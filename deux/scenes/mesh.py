"""A scene's geometry and appearance as plain arrays, the same for every renderer."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Material:
    """An unlit surface: the colour at a point is texture x base colour, with no light and no viewing angle.

    Args:
        name: for messages only.
        color: base colour, 3 x uint8; multiplied onto the texture as color / 255.
        texture: height x width x 3 uint8, row 0 at the top (v = 1), repeated in both directions; or None.
    """

    name: str
    color: tuple[int, int, int] = (255, 255, 255)
    texture: np.ndarray | None = None


@dataclass(frozen=True)
class SceneMesh:
    """Triangles in metres in a Y-up world.

    Args:
        vertices: V x 3 float32.
        faces: F x 3 int32, indices into `vertices`.
        uv: F x 3 x 2 float32, texture coordinates of each corner, (0, 0) at the bottom left of the texture.
        face_material: F int32, index into `materials`.
        materials: the materials.
        face_label: F int32, index into `label_names`, -1 where nothing is known.
        label_names: names of the labels, such as "chair".
        vertex_colors: V x 3 uint8, multiplied onto the material; None where there are none.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    face_material: np.ndarray
    materials: tuple[Material, ...]
    face_label: np.ndarray
    label_names: tuple[str, ...] = ()
    vertex_colors: np.ndarray | None = None

    @property
    def triangles(self) -> np.ndarray:
        """Corner positions, F x 3 x 3 float32."""
        return self.vertices[self.faces]

    @property
    def bounds(self) -> np.ndarray:
        """2 x 3 float32: the least and the greatest corner."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])
