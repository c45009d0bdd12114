"""The character of a room: the difficulty of its surfaces for a depth model, and its amount of furniture."""

from dataclasses import dataclass
from typing import Literal

from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.walls import Finish

Surfacing = Literal["plain", "repeated", "rich"]
Clutter = Literal["bare", "usual", "dense"]


@dataclass(frozen=True)
class Character:
    """The character of one room.

    Args:
        surfacing: nearly uniform surfaces, surfaces with exactly repeated patterns, or richly textured surfaces.
        clutter: the amount of furniture and of pictures on the walls.
    """

    surfacing: Surfacing
    clutter: Clutter


SURFACING: dict[str, tuple[Surfacing, ...]] = {
    "corridor": ("plain", "plain", "plain", "repeated", "repeated", "rich"),
    "closet": ("plain", "plain", "plain", "rich"),
    "storeroom": ("plain", "plain", "plain", "rich"),
    "library": ("plain", "repeated", "rich", "rich"),
    "bathroom": ("repeated", "repeated", "plain", "rich"),
}
ANY_SURFACING: tuple[Surfacing, ...] = ("plain", "plain", "plain", "repeated", "repeated", "rich", "rich", "rich")
CLUTTER: dict[str, tuple[Clutter, ...]] = {
    "corridor": ("bare", "bare", "bare", "usual"),
    "hall": ("bare", "usual", "usual", "dense"),
    "closet": ("usual", "dense", "dense"),
    "storeroom": ("usual", "dense", "dense"),
    "library": ("usual", "dense"),
    "living room": ("usual", "usual", "dense"),
    "bedroom": ("usual", "usual", "dense"),
    "kitchen": ("usual", "dense"),
    "bathroom": ("usual", "usual", "dense"),
}
ANY_CLUTTER: tuple[Clutter, ...] = ("bare", "usual", "usual", "usual", "dense", "dense")
"""Options from which a room draws one; options that are listed several times are more probable."""


def draw_character(kind: str, draws: Draws) -> Character:
    """Draw the character of a room of the given kind."""
    return Character(
        draws.choice(SURFACING.get(kind, ANY_SURFACING)),
        draws.choice(CLUTTER.get(kind, ANY_CLUTTER)),
    )


RICH_WALLS = ("plaster", "striped wallpaper", "flowered wallpaper", "geometric wallpaper", "panelling", "brick")
RICH_FLOORS = ("planks", "parquet", "carpet", "terrazzo", "floor tiles")
RICH_CEILINGS = ("plaster", "ceiling panels", "panelling")
WET_ROOMS = frozenset({"kitchen", "bathroom"})


def draw_finish(kind: str, surfacing: Surfacing, style: Style) -> Finish:
    """Draw the materials of a room's floor, ceiling and walls."""
    if surfacing == "plain":
        floor = style.pick("linoleum", "linoleum", "screed", "planks")
        ceiling = upper = style.pick("distemper")
        if style.draws.chance(0.5):
            ceiling = style.pick("distemper", "ceiling grid")
        lower = style.pick("distemper") if style.draws.chance(0.3) else upper
        accent = upper
    elif surfacing == "repeated":
        floor = style.pick("chequers", "mosaic", "linoleum", "carpet")
        ceiling = style.pick("ceiling grid", "distemper")
        upper = style.pick("mosaic") if kind in WET_ROOMS else style.pick("damask", "damask", "mosaic")
        lower, accent = upper, upper
    else:
        floor = style.pick("floor tiles", "terrazzo") if kind in WET_ROOMS else style.pick(*RICH_FLOORS)
        ceiling = style.pick(*RICH_CEILINGS)
        upper = style.pick(*RICH_WALLS)
        wainscot = "wall tiles" if kind in WET_ROOMS else "panelling"
        lower = style.pick(wainscot) if kind in WET_ROOMS or style.draws.chance(0.2) else upper
        accent = style.pick(*RICH_WALLS) if style.draws.chance(0.3) else upper
    border = style.draws.choice((1.0, 1.2, 1.5)) if lower != upper else 0.0
    return Finish(floor, ceiling, upper, lower, border, accent)
