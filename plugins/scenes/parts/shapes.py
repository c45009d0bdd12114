"""Models of furniture as lists of textured quadrilaterals.

In the frame of a model x points to its right and z to its front; the origin is on the floor in the middle of its back.
Quadrilaterals are counter-clockwise as seen from outside.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deux_plugins.scenes.parts.surfaces import MATERIAL_KINDS, Surface

Point = tuple[float, float, float]

ANGLE_DECIMALS = 6
"""Decimals to which sines and cosines are rounded, because the last bit differs between implementations of libm."""


@dataclass(frozen=True)
class Quads:
    """Quadrilaterals of one surface and label.

    Args:
        corners: N x 4 x 3, metres.
        uv: N x 4 x 2, metres along the surface; 0 to 1 if the texture is fitted to the face.
        surface: their material.
        label: their semantic label.
    """

    corners: np.ndarray
    uv: np.ndarray
    surface: Surface
    label: str


def rectangle(origin: Point, right: Point, up: Point, surface: Surface, label: str) -> Quads:
    """A rectangle, given by its lower left corner and two edges along axes; its normal is right x up."""
    corner, a, b = (np.asarray(vector, dtype=np.float64) for vector in (origin, right, up))
    width, height = np.abs(a).max(), np.abs(b).max()
    corners = np.stack([corner, corner + a, corner + a + b, corner + b])
    uv = _lay(np.zeros((1, 2)), np.array([[width, height]]), surface)
    return Quads(corners[None], uv, surface, label)


# Corners of the faces of a box (front, back, right, left, top, bottom), counter-clockwise as seen from outside from the
# lower left corner: 0 is the least coordinate, 1 the greatest. Then the axes of u and v.
_BOX_CORNERS = np.array(
    [
        [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
        [[1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]],
        [[1, 0, 1], [1, 0, 0], [1, 1, 0], [1, 1, 1]],
        [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]],
        [[0, 1, 1], [1, 1, 1], [1, 1, 0], [0, 1, 0]],
        [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]],
    ],
    dtype=bool,
)
_BOX_U, _BOX_V = np.array([0, 0, 2, 2, 0, 0]), np.array([1, 1, 1, 1, 2, 2])
_UNIT_UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])

ALL_FACES = np.arange(6)
SIDE_FACES = np.arange(5)
FRONT_FACE = np.arange(1)


def _box_faces(low: Point, high: Point, faces: np.ndarray, surface: Surface, label: str) -> Quads:
    least, greatest = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
    corners = np.where(_BOX_CORNERS[faces], greatest, least)
    extent, start = greatest - least, np.abs(least)
    size = np.stack([extent[_BOX_U[faces]], extent[_BOX_V[faces]]], axis=-1)
    origin = np.stack([start[_BOX_U[faces]], start[_BOX_V[faces]]], axis=-1)
    return Quads(corners, _lay(origin, size, surface), surface, label)


def _lay(origin: np.ndarray, size: np.ndarray, surface: Surface) -> np.ndarray:
    """Texture coordinates, N x 4 x 2, of faces that begin at `origin`, N x 2 metres, and have `size`, N x 2 metres."""
    kind = MATERIAL_KINDS[surface.kind]
    fitted = np.array({"none": (False, False), "height": (False, True), "face": (True, True)}[kind.fit])
    uv = np.where(fitted, 0.0, origin)[:, None] + _UNIT_UV * np.where(fitted, 1.0, size)[:, None]
    if kind.grain:
        upright = size[:, 1] > size[:, 0]
        uv[upright] = uv[upright][..., ::-1]
    return uv


class Model:
    """Builder of a piece of furniture.

    Args:
        label: default label of its parts.
        width: extent along x, metres.
        depth: extent along z, metres.
        height: extent along y, metres.
        front: metres in front of it that must stay free, such as for opening a door.
        hangs: whether it hangs; standing models have no faces at their bottom, height 0.
    """

    def __init__(
        self,
        label: str,
        width: float,
        depth: float,
        height: float,
        *,
        front: float = 0.0,
        hangs: bool = False,
    ) -> None:
        self.label = label
        self.width = width
        self.depth = depth
        self.height = height
        self.front = front
        self.hangs = hangs
        self.parts: list[Quads] = []

    def box(
        self,
        low: Point,
        high: Point,
        surface: Surface,
        *,
        front: Surface | None = None,
        label: str | None = None,
    ) -> None:
        """Add an axis-aligned box from its least to its greatest corner; `front` is the material of its +z face.

        The lower face of a box at the bottom of a standing model is left out.
        """
        name = label or self.label
        faces = ALL_FACES if low[1] > 0.0 or self.hangs else SIDE_FACES
        if front is not None:
            self.parts.append(_box_faces(low, high, FRONT_FACE, front, name))
            faces = faces[1:]
        self.parts.append(_box_faces(low, high, faces, surface, name))

    def turned(
        self,
        base: Point,
        profile: Sequence[tuple[float, float]],
        surface: Surface,
        *,
        sides: int = 10,
        axis: str = "y",
        label: str | None = None,
    ) -> None:
        """Add a solid of revolution.

        Args:
            base: lower end of the axis.
            profile: (height above the base, radius > 0) from bottom to top, metres.
            surface: its material.
            sides: even number of sides.
            axis: "y" for a vertical axis, "z" for an axis to the front.
            label: label; by default the model's.
        """
        turn = [2.0 * math.pi * (step + 0.5) / sides for step in range(sides)]
        circle = np.array([(round(math.sin(a), ANGLE_DECIMALS), 0.0, round(math.cos(a), ANGLE_DECIMALS)) for a in turn])
        rings = np.stack([circle * radius + (0.0, height, 0.0) for height, radius in profile])
        corners, uv = _lathe(rings, [radius for _, radius in profile])
        if axis == "z":
            corners = np.stack([corners[..., 0], -corners[..., 2], corners[..., 1]], axis=-1)
        if axis == "y" and base[1] <= 0.0 and not self.hangs:
            corners, uv = corners[: -(sides // 2 - 1)], uv[: -(sides // 2 - 1)]
        if MATERIAL_KINDS[surface.kind].fit != "none":
            uv = np.broadcast_to(_UNIT_UV, uv.shape)
        self.parts.append(Quads(corners + np.asarray(base), uv, surface, label or self.label))

    def add(self, other: "Model", x: float, y: float, z: float) -> None:
        """Add another model with its origin at (x, y, z)."""
        shift = np.array([x, y, z])
        self.parts += [Quads(part.corners + shift, part.uv, part.surface, part.label) for part in other.parts]


def _lathe(rings: np.ndarray, radii: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Quadrilaterals between K x sides x 3 rings, then those of the top and bottom caps; and their uv in metres."""
    count = rings.shape[1]
    following = np.roll(rings, -1, axis=1)
    sides = np.stack([rings[:-1], following[:-1], following[1:], rings[1:]], axis=2).reshape(-1, 4, 3)
    edge = 2.0 * math.pi * max(radii) / count
    change = np.diff(rings[:, 0], axis=0)
    steps = np.sqrt(change[:, 0] * change[:, 0] + change[:, 1] * change[:, 1] + change[:, 2] * change[:, 2])
    along = np.concatenate([[0.0], np.cumsum(steps)])
    u = np.arange(count) * edge
    v_low, v_high = np.repeat(along[:-1], count), np.repeat(along[1:], count)
    u = np.tile(u, len(rings) - 1)
    side_uv = np.stack(
        [np.stack(pair, axis=-1) for pair in ((u, v_low), (u + edge, v_low), (u + edge, v_high), (u, v_high))],
        axis=1,
    )
    # The cap of a polygon with an even number of sides is a fan of quadrilaterals.
    order = [[0, i + 1, i + 2, i + 3] for i in range(0, count - 2, 2)]
    top = rings[-1][np.array(order)]
    bottom = rings[0][np.array(order)[:, ::-1]]
    caps = np.concatenate([top, bottom])
    return np.concatenate([sides, caps]), np.concatenate([side_uv, caps[..., [0, 2]]])
