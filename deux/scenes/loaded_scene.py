"""Loading of a scene from its reference; a mesh that breaks the contract of `SceneMesh` is an error, not a crash."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from deux.broken_contracts import broken_contract
from deux.contracts import Floor, Material, Scene, SceneMesh, SceneReference
from deux.errors import kind_of, sizes
from deux.scenes.splits import described


def loaded_scene(reference: SceneReference | Scene) -> Scene:
    """Load a scene and check it.

    Raises:
        DeuxError: as `SceneReference.load`, or the result is not a valid `Scene`.
    """
    scene: object = reference.load()
    if not isinstance(scene, Scene):
        raise broken_contract(described(reference), kind_of(scene), "a deux.contracts.Scene", "load")
    check_scene(scene, described(reference))
    return scene


def check_scene(scene: Scene, called: str) -> None:
    """Raise DeuxError unless mesh and floors are as the contract says.

    Renderers read a mesh without bounds checks, so that a wrong index would end the process. Memory-mapped arrays were
    checked when they were prepared (`deux.scenes.prepared_scene`): reading them here would read the whole file.

    Args:
        scene: the scene.
        called: the scene in the message.
    """
    if not isinstance(scene.mesh, SceneMesh):
        raise broken_contract(called, f"a mesh that is {kind_of(scene.mesh)}", "a deux.contracts.SceneMesh", "load")
    for given, wanted in _problems(scene.mesh):
        raise broken_contract(called, f"a mesh whose {given}", wanted, "load")
    floors: Any = scene.floors
    if not (isinstance(floors, tuple) and floors and all(isinstance(floor, Floor) for floor in floors)):
        given = "no floor" if floors == () else f"floors that are {kind_of(floors)}"
        raise broken_contract(called, given, "a scene with a tuple of deux.contracts.Floor, the main one first", "load")
    if not all(math.isfinite(floor.height) for floor in floors):
        raise broken_contract(called, "a floor without a finite height", "one in metres, in the world", "load")


def _problems(mesh: SceneMesh) -> Iterator[tuple[str, str]]:
    """What is wrong with a mesh: pairs of what it has, and what that must be."""
    faces = len(mesh.faces) if isinstance(mesh.faces, np.ndarray) else 0
    vertices = len(mesh.vertices) if isinstance(mesh.vertices, np.ndarray) else 0
    arrays: list[tuple[str, tuple[int, ...], type[np.generic]]] = [
        ("vertices", (vertices, 3), np.float32),
        ("faces", (faces, 3), np.int32),
        ("uv", (faces, 3, 2), np.float32),
        ("face_material", (faces,), np.int32),
        ("face_label", (faces,), np.int32),
    ]
    arrays += [("vertex_colors", (vertices, 3), np.uint8)] if mesh.vertex_colors is not None else []
    arrays += [("face_object", (faces,), np.int32)] if mesh.face_object is not None else []
    for name, shape, dtype in arrays:
        array: Any = getattr(mesh, name)
        if not (isinstance(array, np.ndarray) and array.shape == shape and array.dtype == dtype):
            count = f"for its {faces} faces and {vertices} vertices"
            yield f"array `{name}` is {kind_of(array)}", f"an ndarray of {sizes(shape)}, {np.dtype(dtype)}, {count}"
    if not faces:
        yield "array `faces` is empty", "a mesh with faces"
    for name in ("vertices", "uv"):
        values = getattr(mesh, name)
        if _is_read(values) and not np.isfinite(values).all():
            yield f"array `{name}` is not finite", "finite"
    for name, least, end, what in (
        ("faces", 0, vertices, "vertices"),
        ("face_material", 0, len(mesh.materials), "materials"),
        ("face_label", -1, len(mesh.label_names), "label_names"),
        ("face_object", -1, 2**31, "objects"),
    ):
        indices = getattr(mesh, name)
        if indices is not None and _is_read(indices) and (indices.min() < least or indices.max() >= end):
            wanted = f"{least} to {end - 1}, an index into {what}" if end > least else f"a mesh with {what}"
            yield f"array `{name}` goes from {indices.min()} to {indices.max()}", wanted
    for material in mesh.materials:
        if not isinstance(material, Material):
            yield f"materials hold {kind_of(material)}", "a tuple of deux.contracts.Material"
        texture: Any = material.texture
        if texture is not None and (getattr(texture, "dtype", None), texture.shape[2:]) != (np.uint8, (3,)):
            yield f"material {material.name} has a texture that is {kind_of(texture)}", "height x width x 3, uint8"


def _is_read(array: np.ndarray) -> bool:
    """Whether an array is in memory; see `check_scene`."""
    return not isinstance(array.base, np.memmap)
