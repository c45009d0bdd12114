"""The materials of a scene, with textures that are generated on first use and shared."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from deux.contracts import Material
from deux_plugins.scenes.parts import (
    textures_floor,
    textures_monotone,
    textures_object,
    textures_picture,
    textures_wall,
)
from deux_plugins.scenes.parts.canvas import Canvas, Color, NoiseBank, to_bytes
from deux_plugins.scenes.parts.draws import Draws


@dataclass(frozen=True)
class MaterialKind:
    """A kind of material, and the properties of its textures.

    Args:
        paint: generates a texture.
        size: edge of the texture in texels.
        period: edge of the texture in metres.
        variants: number of different textures in a scene.
        fit: whether the texture is stretched over a face ("face"), over its height only ("height"), or not ("none").
        grain: whether u follows the longer side of a face.
    """

    paint: Callable[[Canvas], np.ndarray]
    size: int
    period: float
    variants: int
    fit: Literal["none", "height", "face"] = "none"
    grain: bool = False


MATERIAL_KINDS: dict[str, MaterialKind] = {
    "planks": MaterialKind(textures_floor.planks, 512, 2.56, 2),
    "parquet": MaterialKind(textures_floor.parquet, 512, 2.56, 1),
    "floor tiles": MaterialKind(textures_floor.floor_tiles, 512, 2.56, 2),
    "terrazzo": MaterialKind(textures_floor.terrazzo, 512, 2.56, 1),
    "carpet": MaterialKind(textures_floor.carpet, 512, 2.56, 2),
    "plaster": MaterialKind(textures_wall.plaster, 512, 2.56, 2),
    "striped wallpaper": MaterialKind(textures_wall.striped_wallpaper, 512, 2.56, 2),
    "flowered wallpaper": MaterialKind(textures_wall.flowered_wallpaper, 512, 2.56, 2),
    "geometric wallpaper": MaterialKind(textures_wall.geometric_wallpaper, 512, 2.56, 2),
    "brick": MaterialKind(textures_wall.brick, 512, 2.56, 1),
    "wall tiles": MaterialKind(textures_wall.wall_tiles, 512, 2.56, 2),
    "panelling": MaterialKind(textures_wall.panelling, 512, 2.56, 1),
    "ceiling panels": MaterialKind(textures_wall.ceiling_panels, 512, 2.56, 1),
    "wood": MaterialKind(textures_floor.wood, 256, 1.28, 3, grain=True),
    "paint": MaterialKind(textures_object.paint, 256, 1.28, 2, grain=True),
    "marble": MaterialKind(textures_floor.marble, 256, 1.28, 2),
    "weave": MaterialKind(textures_object.weave, 256, 1.28, 3),
    "plaid": MaterialKind(textures_object.plaid, 256, 1.28, 2),
    "linen": MaterialKind(textures_object.linen, 256, 1.28, 2),
    "leather": MaterialKind(textures_object.leather, 256, 1.28, 2),
    "metal": MaterialKind(textures_object.brushed_metal, 256, 1.28, 2, grain=True),
    "enamel": MaterialKind(textures_object.enamel, 256, 1.28, 2),
    "foliage": MaterialKind(textures_object.foliage, 256, 0.9, 2),
    "cardboard": MaterialKind(textures_object.cardboard, 256, 1.02, 1),
    "books": MaterialKind(textures_object.book_spines, 256, 1.02, 3, fit="height"),
    "landscape": MaterialKind(textures_picture.landscape, 256, 1.0, 3, fit="face"),
    "city": MaterialKind(textures_picture.city_view, 256, 1.0, 2, fit="face"),
    "abstract": MaterialKind(textures_picture.abstract, 256, 1.0, 3, fit="face"),
    "still life": MaterialKind(textures_picture.still_life, 256, 1.0, 2, fit="face"),
    "rug": MaterialKind(textures_picture.rug, 256, 1.0, 3, fit="face"),
    "distemper": MaterialKind(textures_monotone.distemper, 256, 2.56, 3),
    "linoleum": MaterialKind(textures_monotone.linoleum, 256, 2.56, 2),
    "screed": MaterialKind(textures_monotone.screed, 256, 2.56, 1),
    "damask": MaterialKind(textures_monotone.damask, 512, 2.56, 2),
    "mosaic": MaterialKind(textures_monotone.mosaic, 512, 2.56, 2),
    "chequers": MaterialKind(textures_monotone.chequers, 512, 2.56, 1),
    "ceiling grid": MaterialKind(textures_monotone.ceiling_grid, 512, 2.56, 1),
}
"""All kinds of material. Texels are 4 to 5 mm; the larger textures are for floors, walls and ceilings."""

TINTS: tuple[Color, ...] = (
    (255, 255, 255),
    (255, 243, 226),
    (232, 242, 255),
    (224, 220, 214),
    (240, 222, 214),
    (222, 232, 216),
)
"""Tints by which textures are multiplied: none, warm, cool, grey, reddish, greenish."""


@dataclass(frozen=True)
class Surface:
    """The material of a face: a variant of a kind of material, multiplied by a tint."""

    kind: str
    variant: int
    tint: Color = (255, 255, 255)


class Surfaces:
    """The surfaces of one scene.

    Args:
        seed: seed of the scene.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._bank = NoiseBank(Draws(seed, "noise"))
        self._textures: dict[tuple[str, int], np.ndarray] = {}
        self._materials: dict[Surface, int] = {}

    def pick(self, draws: Draws, *kinds: str) -> Surface:
        """A surface of one of these kinds of material, with a random variant and tint."""
        kind = draws.choice(kinds)
        variant = draws.integer(0, MATERIAL_KINDS[kind].variants - 1)
        return Surface(kind, variant, draws.choice(TINTS))

    def index(self, surface: Surface) -> int:
        """Index of the surface in `materials`; it is added if necessary."""
        return self._materials.setdefault(surface, len(self._materials))

    @property
    def materials(self) -> tuple[Material, ...]:
        """The materials added so far, in the order of their indices."""
        return tuple(
            Material(
                f"{surface.kind}-{surface.variant}",
                surface.tint,
                self._texture(surface.kind, surface.variant),
            )
            for surface in self._materials
        )

    def _texture(self, name: str, variant: int) -> np.ndarray:
        if (name, variant) not in self._textures:
            kind = MATERIAL_KINDS[name]
            canvas = Canvas(kind.size, Draws(self._seed, f"{name} {variant}"), self._bank)
            self._textures[name, variant] = to_bytes(kind.paint(canvas))
        return self._textures[name, variant]
