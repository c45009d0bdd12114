"""The generator of flats."""

from deux.contracts import Floor, Scene
from deux.errors import DeuxError
from deux_plugins.scenes.apartments.finishes import build_structure
from deux_plugins.scenes.apartments.layout import make_floor_plan
from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.floor_plan import FloorPlan
from deux_plugins.scenes.parts.furnishing import furnish
from deux_plugins.scenes.parts.lighting import Light
from deux_plugins.scenes.parts.mesh_builder import MeshBuilder
from deux_plugins.scenes.parts.placement import RoomSpace
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.surfaces import Surfaces

APARTMENT_VERSION = 1
"""Version of the generator, to be increased whenever the flat of any seed changes."""


def apartment(seed: int) -> Scene:
    """Generate a furnished flat of 35 to 90 square metres, byte by byte the same on every machine.

    Args:
        seed: random seed, 0 or more.

    Returns:
        The scene, with its floor at height 0 and the labels of `LABEL_NAMES`.

    Raises:
        DeuxError: the seed is negative.
    """
    if seed < 0:
        raise DeuxError(f"The seed of a generated flat is {seed}, but must be 0 or more.")
    surfaces = Surfaces(seed)
    plan = make_floor_plan(Draws(seed, "floor plan"))
    builder = MeshBuilder()
    build_structure(plan, Style(surfaces, Draws(seed, "structure")), builder)
    style = Style(surfaces, Draws(seed, "style"))
    for index in range(len(plan.rooms)):
        furnish(RoomSpace(plan, index, builder, Draws(seed, f"places {index}")), style)
    mesh = builder.build(surfaces, _lights(plan, Draws(seed, "light")))
    area = sum(room.area for room in plan.rooms)
    return Scene(f"apartment-{seed:05d}", mesh, (Floor(0.0, area),), f"apartment:{APARTMENT_VERSION}:{seed}")


def _lights(plan: FloorPlan, draws: Draws) -> list[Light]:
    """One lamp for each room, with colours from warm to cool."""
    lights = []
    for room in plan.rooms:
        warmth = draws.uniform(-0.05, 0.07)
        color = (1.0 + warmth * 0.4, 1.0, 1.0 - warmth)
        lights.append(Light(room.rectangle, room.height, color))
    return lights
