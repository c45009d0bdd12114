"""The generator of houses."""

from deux.contracts import Floor, Scene
from deux.errors import DeuxError
from deux_plugins.scenes.houses.character import draw_character, draw_finish
from deux_plugins.scenes.houses.furnishing import furnish_house_room
from deux_plugins.scenes.houses.layout import make_house_plan
from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.floor_plan import FloorPlan
from deux_plugins.scenes.parts.lighting import Light
from deux_plugins.scenes.parts.mesh_builder import MeshBuilder
from deux_plugins.scenes.parts.placement import RoomSpace
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.surfaces import Surfaces
from deux_plugins.scenes.parts.walls import build_room

HOUSE_VERSION = 1
"""Version of the generator, to be increased whenever the house of any seed changes."""

LEAST_AREA, MOST_AREA = 150, 500
"""Range of the floor area, square metres."""

STYLES = 3
"""Number of styles in a house; each room has one of them."""

FIRST_STREAM = 1_000_000_000
"""Is added to the seed, so that a house shares no random numbers with the flat of the same seed."""


def house(seed: int, least_area: int = LEAST_AREA, most_area: int = MOST_AREA) -> Scene:
    """Generate a furnished house with one floor, byte by byte the same on every machine.

    Args:
        seed: random seed, 0 or more.
        least_area: least total area of the rooms, square metres.
        most_area: greatest total area.

    Returns:
        The scene, with its floor at height 0 and the labels of `LABEL_NAMES`.

    Raises:
        DeuxError: the seed is negative.
    """
    if seed < 0:
        raise DeuxError(f"The seed of a generated house is {seed}, but must be 0 or more.")
    stream = FIRST_STREAM + seed
    surfaces = Surfaces(stream)
    plan = house_plan(seed, least_area, most_area)
    styles = [Style(surfaces, Draws(stream, f"style {number}")) for number in range(STYLES)]
    builder = MeshBuilder()
    for index, room in enumerate(plan.rooms):
        draws = Draws(stream, f"character {index}")
        style, character = draws.choice(styles), draw_character(room.kind, draws)
        build_room(plan, index, draw_finish(room.kind, character.surfacing, style), style, builder)
        furnish_house_room(RoomSpace(plan, index, builder, Draws(stream, f"places {index}")), style, character.clutter)
    mesh = builder.build(surfaces, _lights(plan, Draws(stream, "light")))
    area = sum(room.area for room in plan.rooms)
    return Scene(f"house-{seed:05d}", mesh, (Floor(0.0, area),), house_identity(seed, least_area, most_area))


def house_plan(seed: int, least_area: int = LEAST_AREA, most_area: int = MOST_AREA) -> FloorPlan:
    """The floor plan of the house with these arguments."""
    return make_house_plan(Draws(FIRST_STREAM + seed, "floor plan"), least_area, most_area)


def house_identity(seed: int, least_area: int, most_area: int) -> str:
    """A string of the generator's version and arguments."""
    return f"house:{HOUSE_VERSION}:{least_area}-{most_area}:{seed}"


def _lights(plan: FloorPlan, draws: Draws) -> list[Light]:
    """One lamp for each room, with random brightness and colours from warm to cool."""
    lights = []
    for room in plan.rooms:
        warmth = draws.uniform(-0.07, 0.09)
        bright = draws.uniform(0.9, 1.05)
        color = (bright * (1.0 + warmth * 0.4), bright, bright * (1.0 - warmth))
        lights.append(Light(room.rectangle, room.height, color))
    return lights
