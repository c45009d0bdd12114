"""The materials of one scene: textures made when first asked for, and shared by all that is made of the same stuff."""

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
class Stuff:
    """How a texture is made and laid.

    Args:
        paint: makes the texture.
        size: edge of the texture in texels.
        period: edge of the texture in metres.
        variants: how many different ones a scene may hold.
        fit: stretched over a face in both directions ("face"), in its height only ("height"), or not ("none").
        grain: whether u follows the longer side of a face.
    """

    paint: Callable[[Canvas], np.ndarray]
    size: int
    period: float
    variants: int
    fit: Literal["none", "height", "face"] = "none"
    grain: bool = False


STUFFS: dict[str, Stuff] = {
    "planks": Stuff(textures_floor.planks, 512, 2.56, 2),
    "parquet": Stuff(textures_floor.parquet, 512, 2.56, 1),
    "floor tiles": Stuff(textures_floor.floor_tiles, 512, 2.56, 2),
    "terrazzo": Stuff(textures_floor.terrazzo, 512, 2.56, 1),
    "carpet": Stuff(textures_floor.carpet, 512, 2.56, 2),
    "plaster": Stuff(textures_wall.plaster, 512, 2.56, 2),
    "striped wallpaper": Stuff(textures_wall.striped_wallpaper, 512, 2.56, 2),
    "flowered wallpaper": Stuff(textures_wall.flowered_wallpaper, 512, 2.56, 2),
    "geometric wallpaper": Stuff(textures_wall.geometric_wallpaper, 512, 2.56, 2),
    "brick": Stuff(textures_wall.brick, 512, 2.56, 1),
    "wall tiles": Stuff(textures_wall.wall_tiles, 512, 2.56, 2),
    "panelling": Stuff(textures_wall.panelling, 512, 2.56, 1),
    "ceiling panels": Stuff(textures_wall.ceiling_panels, 512, 2.56, 1),
    "wood": Stuff(textures_floor.wood, 256, 1.28, 3, grain=True),
    "paint": Stuff(textures_object.paint, 256, 1.28, 2, grain=True),
    "marble": Stuff(textures_floor.marble, 256, 1.28, 2),
    "weave": Stuff(textures_object.weave, 256, 1.28, 3),
    "plaid": Stuff(textures_object.plaid, 256, 1.28, 2),
    "linen": Stuff(textures_object.linen, 256, 1.28, 2),
    "leather": Stuff(textures_object.leather, 256, 1.28, 2),
    "metal": Stuff(textures_object.brushed_metal, 256, 1.28, 2, grain=True),
    "enamel": Stuff(textures_object.enamel, 256, 1.28, 2),
    "foliage": Stuff(textures_object.foliage, 256, 0.9, 2),
    "cardboard": Stuff(textures_object.cardboard, 256, 1.02, 1),
    "books": Stuff(textures_object.book_spines, 256, 1.02, 3, fit="height"),
    "landscape": Stuff(textures_picture.landscape, 256, 1.0, 3, fit="face"),
    "city": Stuff(textures_picture.city_view, 256, 1.0, 2, fit="face"),
    "abstract": Stuff(textures_picture.abstract, 256, 1.0, 3, fit="face"),
    "still life": Stuff(textures_picture.still_life, 256, 1.0, 2, fit="face"),
    "rug": Stuff(textures_picture.rug, 256, 1.0, 3, fit="face"),
    "distemper": Stuff(textures_monotone.distemper, 256, 2.56, 3),
    "linoleum": Stuff(textures_monotone.linoleum, 256, 2.56, 2),
    "screed": Stuff(textures_monotone.screed, 256, 2.56, 1),
    "damask": Stuff(textures_monotone.damask, 512, 2.56, 2),
    "mosaic": Stuff(textures_monotone.mosaic, 512, 2.56, 2),
    "chequers": Stuff(textures_monotone.chequers, 512, 2.56, 1),
    "ceiling grid": Stuff(textures_monotone.ceiling_grid, 512, 2.56, 1),
}
"""All that a scene can be made of. Texels are 4 to 5 mm; the larger textures serve floors, walls and ceilings."""

TINTS: tuple[Color, ...] = (
    (255, 255, 255),
    (255, 243, 226),
    (232, 242, 255),
    (224, 220, 214),
    (240, 222, 214),
    (222, 232, 216),
)
"""Tints that are multiplied onto the textures: none, warm, cool, grey, reddish, greenish."""


@dataclass(frozen=True)
class Surface:
    """What a face is made of: one variant of a stuff, under a tint that is multiplied onto it."""

    stuff: str
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

    def pick(self, draws: Draws, *stuffs: str) -> Surface:
        """A surface of one of these stuffs, in one of its variants and a light tint."""
        stuff = draws.choice(stuffs)
        variant = draws.integer(0, STUFFS[stuff].variants - 1)
        return Surface(stuff, variant, draws.choice(TINTS))

    def index(self, surface: Surface) -> int:
        """Index of the surface in `materials`, newly entered if need be."""
        return self._materials.setdefault(surface, len(self._materials))

    @property
    def materials(self) -> tuple[Material, ...]:
        """The materials entered so far, in the order of their indices."""
        return tuple(
            Material(
                f"{surface.stuff}-{surface.variant}",
                surface.tint,
                self._texture(surface.stuff, surface.variant),
            )
            for surface in self._materials
        )

    def _texture(self, name: str, variant: int) -> np.ndarray:
        if (name, variant) not in self._textures:
            stuff = STUFFS[name]
            canvas = Canvas(stuff.size, Draws(self._seed, f"{name} {variant}"), self._bank)
            self._textures[name, variant] = to_bytes(stuff.paint(canvas))
        return self._textures[name, variant]
