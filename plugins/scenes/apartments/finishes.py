"""Materials of the floors, walls and ceilings of a flat."""

from deux_plugins.scenes.parts.floor_plan import FloorPlan
from deux_plugins.scenes.parts.mesh_builder import MeshBuilder
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.walls import Finish, build_room

FLOORS = {
    "living room": ("planks", "parquet", "carpet"),
    "bedroom": ("planks", "carpet", "parquet"),
    "study": ("planks", "carpet", "parquet"),
    "kitchen": ("floor tiles", "terrazzo", "planks"),
    "bathroom": ("floor tiles", "terrazzo"),
    "hallway": ("planks", "floor tiles", "parquet"),
}
WALLS = {
    "living room": ("striped wallpaper", "flowered wallpaper", "geometric wallpaper", "plaster", "panelling"),
    "bedroom": ("flowered wallpaper", "striped wallpaper", "geometric wallpaper", "plaster"),
    "study": ("geometric wallpaper", "striped wallpaper", "plaster", "brick"),
    "kitchen": ("plaster", "geometric wallpaper", "brick"),
    "bathroom": ("wall tiles", "plaster"),
    "hallway": ("plaster", "striped wallpaper", "flowered wallpaper"),
}
WAINSCOTS = {"kitchen": ("wall tiles",), "bathroom": ("wall tiles",), "hallway": ("panelling",)}
"""Materials of the lower part of the walls, if it differs from the upper part."""

CEILINGS = ("plaster", "ceiling panels", "panelling")


def build_structure(plan: FloorPlan, style: Style, builder: MeshBuilder) -> None:
    """Add floors, walls and ceilings: one floor material for each kind of room, one ceiling material for all rooms."""
    ceiling = style.pick(*CEILINGS)
    floors = {kind: style.pick(*materials) for kind, materials in FLOORS.items()}
    for index, room in enumerate(plan.rooms):
        upper = style.pick(*WALLS[room.kind])
        lower = style.pick(*WAINSCOTS[room.kind]) if room.kind in WAINSCOTS else upper
        border = style.draws.choice((1.0, 1.2, 1.5)) if lower != upper else 0.0
        accent = style.pick("brick", "panelling", *WALLS[room.kind]) if style.draws.chance(0.3) else upper
        build_room(plan, index, Finish(floors[room.kind], ceiling, upper, lower, border, accent), style, builder)
