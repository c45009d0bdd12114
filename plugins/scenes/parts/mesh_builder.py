"""Placement of models, and construction of the scene's mesh."""

from dataclasses import dataclass

import numpy as np

from deux.contracts import SceneMesh
from deux_plugins.scenes.parts.labels import LABEL_INDEX, LABEL_NAMES
from deux_plugins.scenes.parts.lighting import Light, shade
from deux_plugins.scenes.parts.shapes import Model, Quads
from deux_plugins.scenes.parts.surfaces import MATERIAL_KINDS, Surfaces

DECIMALS = 4
"""Vertices are rounded to 0.1 mm."""

SOUTH, NORTH, EAST, WEST = (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)
"""(cos, sin) of the rotations by which a model's front faces +z, -z, +x and -x."""


@dataclass(frozen=True)
class Placement:
    """The pose of a model: its origin, and the (cosine, sine) of its rotation about the vertical axis."""

    x: float
    z: float
    turn: tuple[float, float] = SOUTH
    y: float = 0.0

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Transform ... x 3 points from the model's frame to the world."""
        cosine, sine = self.turn
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        return np.stack([x * cosine + z * sine + self.x, y + self.y, z * cosine - x * sine + self.z], axis=-1)

    def beside(self, right: float, out: float, turn: tuple[float, float] = SOUTH) -> "Placement":
        """The placement `right` metres to the right and `out` metres in front of this one, rotated relative to it."""
        cosine, sine = self.turn
        return Placement(
            self.x + right * cosine + out * sine,
            self.z + out * cosine - right * sine,
            (cosine * turn[0] - sine * turn[1], sine * turn[0] + cosine * turn[1]),
            self.y,
        )


class MeshBuilder:
    """Collects quadrilaterals in world coordinates."""

    def __init__(self) -> None:
        self._quads: list[Quads] = []

    def extend(self, quads: list[Quads]) -> None:
        """Add quadrilaterals in world coordinates."""
        self._quads += quads

    def add(self, model: Model, placement: Placement) -> None:
        """Add a model; its textures are shifted by its position, so that equal models look different."""
        for part in model.parts:
            fit = MATERIAL_KINDS[part.surface.kind].fit
            shift = np.array([placement.x * 0.7 + placement.z * 0.3, placement.z * 0.6 + placement.y * 0.5])
            shift *= {"none": (1.0, 1.0), "height": (1.0, 0.0), "face": (0.0, 0.0)}[fit]
            self._quads.append(Quads(placement.apply(part.corners), part.uv + shift, part.surface, part.label))

    def build(self, surfaces: Surfaces, lights: list[Light]) -> SceneMesh:
        """Build the mesh: two triangles and four separate vertices for each quadrilateral, with baked lighting."""
        counts = [len(quads.corners) for quads in self._quads]
        total = sum(counts)
        corners = np.round(np.concatenate([quads.corners for quads in self._quads]), DECIMALS)
        periods = np.array([_period(quads) for quads in self._quads])
        uv = np.concatenate([quads.uv for quads in self._quads]) / np.repeat(periods, counts, axis=0)[:, None]
        uv = np.round(uv, DECIMALS + 1)
        uv -= np.floor(uv.min(axis=1, keepdims=True))
        split = np.array([[0, 1, 2], [0, 2, 3]])
        faces = (np.arange(total)[:, None, None] * 4 + split).reshape(-1, 3)
        materials = np.repeat([surfaces.index(quads.surface) for quads in self._quads], counts)
        labels = np.repeat([LABEL_INDEX[quads.label] for quads in self._quads], counts)
        return SceneMesh(
            vertices=corners.reshape(-1, 3).astype(np.float32),
            faces=faces.astype(np.int32),
            uv=uv[:, split].reshape(-1, 3, 2).astype(np.float32),
            face_material=np.repeat(materials, 2).astype(np.int32),
            materials=surfaces.materials,
            face_label=np.repeat(labels, 2).astype(np.int32),
            label_names=LABEL_NAMES,
            vertex_colors=shade(corners, lights).reshape(-1, 3),
        )


def _period(quads: Quads) -> tuple[float, float]:
    kind = MATERIAL_KINDS[quads.surface.kind]
    return {
        "none": (kind.period, kind.period),
        "height": (kind.period, 1.0),
        "face": (1.0, 1.0),
    }[kind.fit]
