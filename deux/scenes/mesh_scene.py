"""Construction of a scene from a mesh: finds its floors, and warns of missing colours and implausible sizes."""

import logging

import numpy as np

from deux.contracts import Floor, Scene, SceneMesh
from deux.errors import DeuxError
from deux.log_once import warn_once
from deux.mesh_files.mesh_extent import describe_size, unit_advice
from deux.scenes.floor import HEADROOM, find_floors
from deux.scenes.ray_caster import RayCaster

log = logging.getLogger(__name__)

LIKELY_CEILING = (1.0, 30.0)
"""Plausible heights of the ceiling above the floor, in metres; outside of them the mesh is probably not in metres."""

_SAMPLES = 2000
_LEVEL = 0.1  # metres from the floor's height within which a surface belongs to the floor


def mesh_scene(name: str, mesh: SceneMesh, identity: str, where: str, scale: float = 1.0) -> Scene:
    """Find the floors of a mesh, and warn once in each process if it has no colours or is probably in a wrong unit.

    Args:
        name: the scene's name.
        mesh: geometry and appearance.
        identity: see `SceneReference`.
        where: the scene's file, for messages.
        scale: metres per unit of the file that were assumed, for messages.

    Raises:
        DeuxError: the mesh has no floor.
    """
    caster = RayCaster(mesh)
    try:
        floors = find_floors(mesh, caster)
    except DeuxError as error:
        sentence = str(error).rstrip(".")
        if np.ptp(mesh.bounds, axis=0).max() < 2.0:
            sentence += f"; the mesh is {describe_size(mesh.bounds)} large, {unit_advice(mesh.bounds, scale)}"
        raise DeuxError(f"{where}: {sentence}.") from error
    ceiling = _ceiling(mesh, floors[0], caster)
    if LIKELY_CEILING[1] < ceiling < np.inf:
        warn_once(log, f"{where}: the ceiling is {ceiling:.2g} m above the floor: {unit_advice(mesh.bounds, scale)}.")
    elif _LEVEL < np.ptp(mesh.bounds[:, 1]) < LIKELY_CEILING[0]:
        warn_once(log, f"{where} is {describe_size(mesh.bounds)} large: {unit_advice(mesh.bounds, scale)}.")
    if not has_colors(mesh):
        warn_once(
            log, f"{where} has no colours: models cannot learn depth from its images, which have a single colour."
        )
    up = mesh.origin[1]
    return Scene(name, mesh, tuple(Floor(floor.height + up, floor.area) for floor in floors), identity)


def has_colors(mesh: SceneMesh) -> bool:
    """Whether images of a mesh can have more than one colour."""
    shown = [mesh.materials[k] for k in np.unique(mesh.face_material)]
    colors = {material.color for material in shown}
    textures = [material.texture for material in shown if material.texture is not None]
    if len(colors) > 1 or any((texture != texture[0, 0]).any() for texture in textures):
        return True
    if len({texture[0, 0].tobytes() for texture in textures}) + (len(textures) < len(shown)) > 1:
        return True
    return mesh.vertex_colors is not None and bool((mesh.vertex_colors != mesh.vertex_colors[0]).any())


def _ceiling(mesh: SceneMesh, floor: Floor, caster: RayCaster) -> float:
    """The median height of the ceiling above the floor in metres, at random points of the floor; infinite outdoors.

    Surfaces nearer than `HEADROOM` are ignored as furniture.
    """
    low, high = mesh.bounds
    origins = np.random.default_rng(0).uniform(low, high, (_SAMPLES, 3))
    origins[:, 1] = floor.height + _LEVEL
    up = np.broadcast_to([0.0, 1.0, 0.0], origins.shape)
    on_floor = caster.cast(origins, -up).distance <= 2 * _LEVEL
    above = caster.cast(origins, up).distance[on_floor] + _LEVEL
    above = above[above > HEADROOM]
    return float(np.median(above)) if len(above) else np.inf
