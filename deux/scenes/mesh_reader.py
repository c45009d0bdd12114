"""Meshes from files: trimesh's geometry and materials as the arrays that renderers use."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from PIL.Image import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.color import to_rgba
from trimesh.visual.material import PBRMaterial

from deux.contracts import Material, SceneMesh
from deux.errors import DeuxError
from deux.scenes.gltf_file import read_gltf
from deux.scenes.mesh_parts import GREY, MeshPart

Up = Literal["y", "z"]
"""The axis of a file that points up."""


def read_mesh(path: Path, up: Up = "y") -> SceneMesh:
    """Read all triangles of a file, with the transforms of its nodes applied; lines and points are left out.

    Colours are taken as they are stored: a material's base colour times its base texture, times the vertices'
    colours. Light, transparency and all other maps are ignored.

    Args:
        path: a .glb, .gltf, .obj or .ply in metres.
        up: "z" turns a Z-up file: world (x, y, z) = (x, z, -y) of the file.

    Raises:
        DeuxError: the file is unreadable or holds no triangles.
    """
    builder = _MeshBuilder()
    if path.suffix.lower() in (".glb", ".gltf"):
        for part in read_gltf(path):
            builder.add_part(part)
        if not builder.faces:
            raise DeuxError(f"{path} holds no triangles: there is nothing to see in it.")
        return builder.build(up)
    try:
        loaded = trimesh.load_scene(path, process=False)
        for node in loaded.graph.nodes_geometry:
            transform, name = loaded.graph[node]
            geometry = loaded.geometry[name]
            if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
                builder.add(geometry, transform)
    except Exception as error:  # the readers of four formats raise whatever they like
        raise DeuxError(
            f"{path} cannot be read as a {path.suffix} file, it is damaged or something else: "
            f"{str(error) or type(error).__name__}."
        ) from error
    if not builder.faces:
        raise DeuxError(f"{path} holds no triangles: there is nothing to see in it.")
    return builder.build(up)


class _MeshBuilder:
    """Joins trimesh's meshes to one; materials and images that several of them use are kept once."""

    def __init__(self) -> None:
        self.vertices: list[np.ndarray] = []
        self.faces: list[np.ndarray] = []
        self.uv: list[np.ndarray] = []
        self.colors: list[np.ndarray | None] = []
        self.face_material: list[np.ndarray] = []
        self.materials: list[Material] = []
        self.indices: dict[tuple[str, tuple[int, ...], int], int] = {}
        self.textures: dict[int, np.ndarray] = {}
        self.count = 0

    def add(self, mesh: trimesh.Trimesh, transform: np.ndarray) -> None:
        """Add a mesh, moved by a 4 x 4 matrix."""
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        visual: Any = mesh.visual
        colors = _vertex_colors(visual, len(vertices))
        if visual.kind == "face":
            # A colour for each face is a colour for each corner of faces that share none.
            vertices = vertices[faces].reshape(-1, 3)
            faces = np.arange(len(vertices)).reshape(-1, 3)
            colors = np.repeat(visual.face_colors[:, :3], 3, axis=0)
        uv = getattr(visual, "uv", None)
        if uv is None or len(uv) != len(vertices):
            uv = None
        self.vertices.append(trimesh.transform_points(vertices, transform))
        self.faces.append(faces + self.count)
        self.uv.append(np.zeros((len(faces), 3, 2)) if uv is None else uv[faces])
        self.colors.append(colors)
        self.face_material.append(np.full(len(faces), self._material_index(visual, uv is not None), np.int32))
        self.count += len(vertices)

    def add_part(self, part: MeshPart) -> None:
        """Add a part."""
        self.vertices.append(part.vertices)
        self.faces.append(part.faces + self.count)
        self.uv.append(np.zeros((len(part.faces), 3, 2)) if part.uv is None else part.uv)
        self.colors.append(part.vertex_colors)
        key = (part.material.name, part.material.color, id(part.material.texture))
        if key not in self.indices:
            self.indices[key] = len(self.materials)
            self.materials.append(part.material)
        self.face_material.append(np.full(len(part.faces), self.indices[key], np.int32))
        self.count += len(part.vertices)

    def build(self, up: Up) -> SceneMesh:
        """All that was added, turned Y-up."""
        vertices = np.concatenate(self.vertices)
        if up == "z":
            vertices = vertices[:, [0, 2, 1]] * (1.0, 1.0, -1.0)
        faces = np.concatenate(self.faces)
        pairs = list(zip(self.colors, self.vertices, strict=True))
        white = [np.full(v.shape, 255, np.uint8) if c is None else c for c, v in pairs]
        return SceneMesh(
            vertices=vertices.astype(np.float32),
            faces=faces.astype(np.int32),
            uv=np.concatenate(self.uv).astype(np.float32),
            face_material=np.concatenate(self.face_material),
            materials=tuple(self.materials),
            face_label=np.full(len(faces), -1, np.int32),
            vertex_colors=None if all(c is None for c in self.colors) else np.concatenate(white),
        )

    def _material_index(self, visual: Any, has_uv: bool) -> int:
        name, color, image = _appearance(visual)
        image = image if has_uv else None
        key = (name, color, id(image))
        if key not in self.indices:
            self.indices[key] = len(self.materials)
            self.materials.append(Material(name, color, None if image is None else self._texture(image)))
        return self.indices[key]

    def _texture(self, image: Image) -> np.ndarray:
        if id(image) not in self.textures:
            self.textures[id(image)] = np.asarray(image.convert("RGB"))
        return self.textures[id(image)]


def _appearance(visual: Any) -> tuple[str, tuple[int, int, int], Image | None]:
    """The name, base colour and base texture of a mesh's only material."""
    white = (255, 255, 255)
    if isinstance(visual, ColorVisuals):
        return "colours", white if visual.defined else GREY, None
    material = visual.material
    if isinstance(material, PBRMaterial):
        factor, image = material.baseColorFactor, material.baseColorTexture
        return material.name, white if factor is None else _rgb(factor), image
    # Exporters leave arbitrary diffuse colours on textured .obj materials: viewers show the texture alone.
    return material.name, white if material.image is not None else _rgb(material.diffuse), material.image


def _vertex_colors(visual: Any, count: int) -> np.ndarray | None:
    """Colours of `count` vertices, V x 3 uint8, or None."""
    if not isinstance(visual, TextureVisuals):
        return visual.vertex_colors[:, :3] if visual.kind == "vertex" else None
    stored = visual.vertex_attributes.get("color")
    if stored is None or len(stored) != count:
        return None
    return to_rgba(stored // 257 if stored.dtype == np.uint16 else stored)[:, :3]


def _rgb(rgba: np.ndarray) -> tuple[int, int, int]:
    red, green, blue = (int(value) for value in rgba[:3])
    return red, green, blue
