"""Reading of scene meshes from files: the parts are joined, checked and converted to metres and Y-up."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from deux.contracts import Material, SceneMesh
from deux.errors import DeuxError
from deux.geometry.texture_pyramids import TexturePyramids, pack_pyramids
from deux.mesh_files.gltf_file import read_gltf, referenced_by_gltf
from deux.mesh_files.mesh_extent import check_extent, near_faces
from deux.mesh_files.mesh_parts import MeshPart, check_indices
from deux.mesh_files.obj_file import read_obj, referenced_by_obj
from deux.mesh_files.part_files import find_part, limited_texture
from deux.mesh_files.ply_file import read_ply, referenced_by_ply

log = logging.getLogger(__name__)

SUFFIXES = (".glb", ".gltf", ".obj", ".ply")
"""The supported suffixes of mesh files, in lower case."""

FAR = 1000.0
"""Distance in metres from the file's origin beyond which the mesh gets another origin, for the precision of float32."""

LARGEST_COORDINATE = 1e12
"""Greatest coordinate of a vertex in the file's units; larger ones count as infinite."""

Up = Literal["y", "z"]
"""The axis of a file that points up."""


def read_mesh(path: Path, up: Up = "y", scale: float = 1.0, max_texture: int | None = None) -> SceneMesh:
    """Read all triangles of a file, with the transforms of its nodes applied; lines and points are left out.

    The colour is base colour x base texture x vertex colour as stored. Lighting, transparency and all other maps are
    ignored.

    Args:
        path: a .glb, .gltf, .obj or .ply file.
        up: "z" rotates a Z-up file: world (x, y, z) = (x, z, -y) of the file.
        scale: metres per unit of the file.
        max_texture: greatest size in pixels of a texture's longer side; larger textures are halved until they fit; None
            for no limit.

    Raises:
        DeuxError: the file is unreadable or damaged, contains no triangles, or is too large for a building in metres.
    """
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        parts = read_gltf(path)
    else:
        parts = (read_obj if suffix == ".obj" else read_ply)(path, max_texture)
    if not parts:
        raise DeuxError(f"{path} contains no triangles: a scene needs surfaces.")
    vertices, colors = _joined_vertices(parts)
    faces = _joined_faces(parts, path)
    finite = (np.abs(vertices) <= LARGEST_COORDINATE).all(axis=1)
    if not finite.all():
        if not (whole := finite[faces].all(axis=1)).all():
            raise DeuxError(f"{path} is damaged: {(~whole).sum()} of its faces have a vertex at NaN or infinity.")
        vertices[~finite] = np.nan
    material_of_part, materials = _joined_materials(parts)
    vertices *= scale
    if up == "z":
        vertices = vertices[:, [0, 2, 1]] * (1.0, 1.0, -1.0)
    vertices, colors, faces = _without_unused(vertices, colors, faces)
    faces_of_part = [len(part.faces) for part in parts]
    uv = np.concatenate([np.zeros((len(p.faces), 3, 2), np.float32) if p.uv is None else p.uv for p in parts])
    mesh = SceneMesh(
        vertices=vertices,
        faces=faces,
        uv=uv,
        face_material=np.repeat(material_of_part, faces_of_part).astype(np.int32),
        materials=(),
        face_label=np.full(len(faces), -1, np.int32),
        vertex_colors=colors,
    )
    mesh = _without_stray(mesh, path)
    check_extent(path, mesh.bounds, scale)
    del parts  # so that textures can be freed one by one while they are packed
    packed, pyramids = _packed(materials, max_texture)
    return replace(_from_origin(mesh), materials=tuple(packed), pyramids=pyramids)


def referenced_files(path: Path) -> list[Path]:
    """The files that a scene file refers to: buffers, material libraries and textures.

    Raises:
        DeuxError: one of them is missing, or the file cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return referenced_by_obj(path)
    if suffix == ".ply":
        return referenced_by_ply(path)
    return [find_part(name, path) for name in referenced_by_gltf(path)]


def _joined_vertices(parts: Sequence[MeshPart]) -> tuple[np.ndarray, np.ndarray | None]:
    """The vertices of all parts and their colours (white for parts without); shared arrays are included once."""
    pairs = {_vertex_key(part): (part.vertices, part.vertex_colors) for part in parts}.values()
    vertices = np.concatenate([vertices for vertices, _ in pairs]).astype(np.float64)
    if all(colors is None for _, colors in pairs):
        return vertices, None
    return vertices, np.concatenate([np.full(v.shape, 255, np.uint8) if c is None else c for v, c in pairs])


def _joined_faces(parts: Sequence[MeshPart], path: Path) -> np.ndarray:
    """The faces of all parts as indices into the joined vertices, F x 3 int64."""
    first: dict[tuple[int, int], int] = {}
    count, faces = 0, []
    for part in parts:
        check_indices(part.faces, len(part.vertices), path)
        key = _vertex_key(part)
        if key not in first:
            first[key] = count
            count += len(part.vertices)
        faces.append(part.faces + first[key])
    return np.concatenate(faces)


def _vertex_key(part: MeshPart) -> tuple[int, int]:
    return id(part.vertices), id(part.vertex_colors)


def _joined_materials(parts: Sequence[MeshPart]) -> tuple[np.ndarray, list[Material]]:
    """The index of each part's material, and the materials without duplicates."""
    indices: dict[tuple[str, tuple[int, ...], int], int] = {}
    materials: list[Material] = []
    of_part = []
    for part in parts:
        key = (part.material.name, part.material.color, id(part.material.texture))
        if key not in indices:
            indices[key] = len(materials)
            materials.append(part.material)
        of_part.append(indices[key])
    return np.array(of_part), materials


def _packed(materials: list[Material], max_texture: int | None) -> tuple[list[Material], TexturePyramids | None]:
    """Pack the textures of materials into mip pyramids; returns materials with views of these, and the pyramids.

    The given list is emptied, so that textures are freed while they are packed: for large scans, all textures and their
    pyramids together (7/3 of the textures' size) may not fit into memory.
    """
    textures = {id(m.texture): m.texture for m in materials if m.texture is not None}
    number = {key: k for k, key in enumerate(textures)}
    texture_of = [number.get(id(material.texture), -1) for material in materials]
    plain = [replace(material, texture=None) for material in materials]
    materials.clear()
    if not textures:
        return plain, None
    pyramids = pack_pyramids([limited_texture(textures.pop(key), max_texture) for key in number], texture_of)
    shown = [pyramids.texture(k) for k in range(len(number))]
    return [
        material if k < 0 else replace(material, texture=shown[k])
        for material, k in zip(plain, texture_of, strict=True)
    ], pyramids


def _without_unused(
    vertices: np.ndarray, colors: np.ndarray | None, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Remove unused vertices if they extend the bounds; returns vertices, colours and faces (int32)."""
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    low, high = vertices[used].min(axis=0), vertices[used].max(axis=0)
    if ((vertices >= low) & (vertices <= high)).all():
        return vertices, colors, faces.astype(np.int32)
    number = np.cumsum(used, dtype=np.int32) - 1
    return vertices[used], None if colors is None else colors[used], number[faces].astype(np.int32)


def _without_stray(mesh: SceneMesh, path: Path) -> SceneMesh:
    """Remove triangles that are far away from all others, with a warning."""
    near = near_faces(mesh.vertices, mesh.faces)
    if near.all():
        return mesh
    log.warning("%s: %d of %d triangles are far away from all others and are removed.", path, np.sum(~near), len(near))
    vertices, colors, faces = _without_unused(mesh.vertices, mesh.vertex_colors, mesh.faces[near])
    return replace(
        mesh,
        vertices=vertices,
        vertex_colors=colors,
        faces=faces,
        uv=mesh.uv[near],
        face_material=mesh.face_material[near],
        face_label=mesh.face_label[near],
    )


def _from_origin(mesh: SceneMesh) -> SceneMesh:
    """Convert the vertices to float32, relative to a near origin along axes on which they are far from 0."""
    low, high = mesh.bounds.astype(np.float64)
    origin = np.where(np.maximum(np.abs(low), np.abs(high)) > FAR, np.floor(low), 0.0)
    x, y, z = (float(value) for value in origin)
    return replace(mesh, vertices=(mesh.vertices - origin).astype(np.float32), origin=(x, y, z))
