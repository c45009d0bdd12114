"""glTF by trimesh, until `deux.scenes.gltf_file` reads it: to be deleted with the two lines that import it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.color import to_rgba

from deux.contracts import Material
from deux.errors import DeuxError
from deux.scenes.mesh_parts import GREY, MeshPart


def read_gltf(path: Path) -> list[MeshPart]:
    """The triangles of a .glb or .gltf."""
    parts, textures = [], {}
    try:
        loaded = trimesh.load_scene(path, process=False)
        for node in loaded.graph.nodes_geometry:
            transform, name = loaded.graph[node]
            mesh = loaded.geometry[name]
            if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
                continue
            visual: Any = mesh.visual
            vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
            uv, colors, material = getattr(visual, "uv", None), None, Material("colours")
            if isinstance(visual, ColorVisuals):
                material = Material("colours", (255, 255, 255) if visual.defined else GREY)
                colors = visual.vertex_colors[:, :3] if visual.kind == "vertex" else None
            elif isinstance(visual, TextureVisuals):
                look: Any = visual.material
                factor, image = look.baseColorFactor, look.baseColorTexture
                color: Any = (255, 255, 255) if factor is None else tuple(int(c) for c in factor[:3])
                if image is not None and id(image) not in textures:
                    textures[id(image)] = np.asarray(image.convert("RGB"))
                material = Material(look.name, color, None if image is None else textures[id(image)])
                stored = visual.vertex_attributes.get("color")
                if stored is not None and len(stored) == len(vertices):
                    colors = to_rgba(stored // 257 if stored.dtype == np.uint16 else stored)[:, :3]
            moved = trimesh.transform_points(vertices, transform)
            corners = uv[faces].astype(np.float32) if uv is not None and len(uv) == len(vertices) else None
            parts.append(MeshPart(moved, faces, material, corners, colors))
    except Exception as error:
        raise DeuxError(
            f"{path} cannot be read as a {path.suffix} file, it is damaged or something else: "
            f"{str(error) or type(error).__name__}."
        ) from error
    return parts


def referenced_by_gltf(path: Path) -> list[str]:
    """The buffers and images of a .glb or .gltf that are files of their own."""
    try:
        header = json.loads(_glb_header(path) if path.suffix.lower() == ".glb" else path.read_bytes())
        if any(image.get("mimeType") == "image/ktx2" for image in header.get("images", ())):
            raise DeuxError(f"{path} has Basis (KTX2) textures, which cannot be read: take its JPEG or PNG version.")
        entries = (*header.get("buffers", ()), *header.get("images", ()))
        return [e["uri"] for e in entries if "uri" in e and not e["uri"].startswith("data:")]
    except (ValueError, AttributeError) as error:
        raise DeuxError(f"{path} cannot be read as a {path.suffix} file: {error}.") from error


def _glb_header(path: Path) -> bytes:
    with path.open("rb") as file:
        start = file.read(20)
        if start[:4] != b"glTF":
            raise ValueError("it does not begin as such a file does")
        whole, there = int.from_bytes(start[8:12], "little"), path.stat().st_size
        if there < whole:
            raise ValueError(f"it is truncated to {there} of {whole} bytes")
        return file.read(int.from_bytes(start[12:16], "little"))
