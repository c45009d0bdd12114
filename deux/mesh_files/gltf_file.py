"""Reader of glTF 2.0 files, .gltf and .glb: the nodes of a scene, and the triangles of their meshes.

The other modules `gltf_*` read the parts of such a file. Specification: Khronos Group, glTF 2.0
(ISO/IEC 12113:2022), sections 3.5 and 3.7; EXT_mesh_gpu_instancing, KHR_node_visibility.
"""

import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from deux.contracts import Material
from deux.memory_budget import check_memory
from deux.mesh_files.gltf_document import GltfDocument
from deux.mesh_files.gltf_materials import (
    BaseTexture,
    Sampling,
    WrappedTexture,
    base_texture,
    colors_as_bytes,
    decode_images,
    make_material,
)
from deux.mesh_files.gltf_primitives import SURFACES, Geometry, read_accessor, read_geometry
from deux.mesh_files.mesh_parts import MeshPart

log = logging.getLogger(__name__)

_INSTANCES = "EXT_mesh_gpu_instancing"
_IDENTITY = {"TRANSLATION": (0, 0, 0), "ROTATION": (0, 0, 0, 1), "SCALE": (1, 1, 1)}
_PART_BYTES, _VERTEX_BYTES, _FACE_BYTES = 2000, 150, 250  # memory while the parts of a scene are joined


def read_gltf(path: Path) -> list[MeshPart]:
    """Read all triangles of the default scene of a glTF file, with the transforms of the nodes applied.

    The colour is base colour factor x base texture x COLOR_0 as stored; lighting, transparency and all other maps are
    ignored. Animated meshes have the pose of their skin's nodes and the default weights of their morph targets. Points,
    lines and other parts that are left out are counted in the log. Images that no triangle uses are not decoded.

    Args:
        path: a .gltf or .glb file; files that it refers to are in the same folder.

    Returns:
        A part for each primitive with triangles of each mesh, for each node and instance.

    Raises:
        DeuxError: the file, or one that it refers to, is missing, damaged, or needs an extension that is not supported
            or a package that is not installed.
    """
    document = GltfDocument(path)
    nodes = _place_nodes(document)
    reader = _MeshReader(document)
    drawn: list[tuple[_Placed, list[_Surface]]] = []
    for node in nodes.values():
        if node.visible and "mesh" in node.entry:
            drawn.append((node, reader.surfaces(node.entry)))
    _check_amount(document, drawn)
    appearances = _Appearances(document, (surface for _, surfaces in drawn for surface in surfaces))
    parts = []
    for node, surfaces in drawn:
        with document.reading(f"nodes[{node.index}]"):
            for surface in surfaces:
                vertices = surface.geometry.attributes["POSITION"].astype(np.float64)
                for placed, mirrored in _place_vertices(document, nodes, node, surface.geometry, vertices):
                    parts.append(appearances.part(surface, placed, mirrored))
    _log_left_out(document, reader.left_out)
    return parts


def referenced_by_gltf(path: Path) -> list[str]:
    """Names of the files that a glTF file refers to: buffers, and images of base colours.

    Args:
        path: a .gltf or .glb file.

    Returns:
        Decoded paths relative to the folder of `path`, without duplicates; they may not exist.

    Raises:
        DeuxError: the file is damaged or needs an extension that is not supported.
    """
    document = GltfDocument(path)
    with document.reading("its list of files"):
        used = [base_texture(document, index) for index in range(len(document.header.get("materials", ())))]
        images = sorted({texture.sampling.image for texture in used if texture is not None})
        entries = [*document.header.get("buffers", ()), *(document.element("images", index) for index in images)]
        names = [document.file_name(entry["uri"]) for entry in entries if "uri" in entry]
        return list(dict.fromkeys(name for name in names if name is not None))


@dataclass(frozen=True)
class _Placed:
    """A node of the scene: its JSON, its 4 x 4 transform to the world, and whether it is visible."""

    index: int
    entry: dict[str, Any]
    world: np.ndarray
    visible: bool


@dataclass(frozen=True, eq=False)
class _Surface:
    """A primitive with triangles: its place in the file, geometry, material and texture."""

    place: str
    geometry: Geometry
    material: int | None
    texture: BaseTexture | None

    def texture_coordinates(self, texture: BaseTexture) -> np.ndarray:
        """Texture coordinates of each vertex, V x 2, with (0, 0) at the top left of the image."""
        stored = np.nan_to_num(self.geometry.attributes[texture.attribute].astype(np.float64), posinf=0, neginf=0)
        return stored @ texture.transform[:, :2].T + texture.transform[:, 2]


class _MeshReader:
    """Reads the primitives of meshes, once even if several nodes use them, and counts those without triangles."""

    def __init__(self, document: GltfDocument) -> None:
        self.left_out: Counter[str] = Counter()
        self._document = document
        self._read: dict[tuple[Any, ...], list[_Surface]] = {}

    def surfaces(self, node: dict[str, Any]) -> list[_Surface]:
        """The surfaces of a node's mesh, with morph targets weighted by the node or else by the mesh."""
        with self._document.reading(f"meshes[{node['mesh']}]"):
            mesh = self._document.element("meshes", node["mesh"])
            weights = tuple(node.get("weights", mesh.get("weights", ())))
            key = (node["mesh"], weights, "skin" in node)
            primitives = list(mesh["primitives"])
        if key not in self._read:
            surfaces = []
            for number, primitive in enumerate(primitives):
                name = f" ({mesh['name']})" if mesh.get("name") else ""
                place = f"meshes[{node['mesh']}].primitives[{number}]{name}"
                with self._document.reading(place):
                    surface = self._surface(primitive, place, weights, "skin" in node)
                surfaces += [surface] if surface else []
            self._read[key] = surfaces
        return self._read[key]

    def _surface(
        self, primitive: dict[str, Any], place: str, weights: Sequence[float], skinned: bool
    ) -> _Surface | None:
        mode = primitive.get("mode", 4)
        attributes = primitive["attributes"]
        if mode not in SURFACES or "POSITION" not in attributes:
            if mode not in range(7):
                raise ValueError(f"there is no primitive mode {mode}")
            kind = "points" if mode == 0 else "lines" if mode < 4 else "triangles without positions"
            self.left_out[f"primitives of {kind}"] += 1
            return None
        material = primitive.get("material")
        texture = base_texture(self._document, material)
        if texture is not None and texture.attribute not in attributes:
            log.warning(
                "%s: %s has no %s for its texture, which is left out", self._document.path, place, texture.attribute
            )
            texture = None
        names = ["POSITION", "COLOR_0", *([texture.attribute] if texture else ())]
        if skinned:
            names += [name for name in attributes if name.startswith(("JOINTS_", "WEIGHTS_"))]
        if primitive.get("targets"):
            self.left_out["morph animations, with default weights"] += 1
        geometry = read_geometry(self._document, primitive, names, weights)
        return _Surface(place, geometry, material, texture) if len(geometry.faces) else None


class _Appearances:
    """Materials and textures of surfaces. Surfaces share materials, and each image is decoded once."""

    def __init__(self, document: GltfDocument, surfaces: Iterable[_Surface]) -> None:
        self._document = document
        self._materials: dict[tuple[Any, ...], Material] = {}
        used: dict[Sampling, dict[_Surface, np.ndarray]] = {}
        for surface in surfaces:
            if surface.texture is not None:
                uv = surface.texture_coordinates(surface.texture)
                used.setdefault(surface.texture.sampling, {})[surface] = uv
        images = decode_images(document, (sampling.image for sampling in used))
        self._textures: dict[Sampling, np.ndarray] = {}
        self._uv: dict[_Surface, np.ndarray] = {}
        for sampling, coordinates in used.items():
            place = f"{document.path}: images[{sampling.image}]"
            texture = WrappedTexture(images[sampling.image], sampling.wraps, list(coordinates.values()), place)
            self._textures[sampling] = texture.image
            for surface, uv in coordinates.items():
                self._uv[surface] = texture.coordinates(uv)[surface.geometry.faces]

    def part(self, surface: _Surface, vertices: np.ndarray, mirrored: bool) -> MeshPart:
        """A part in world coordinates; the corners of mirrored faces are reversed to preserve their orientation."""
        corners = slice(None, None, -1) if mirrored else slice(None)
        sampling = surface.texture.sampling if surface.texture else None
        uv, colors = self._uv.get(surface), surface.geometry.attributes.get("COLOR_0")
        key = (surface.material, sampling, colors is None)
        if key not in self._materials:
            image = self._textures[sampling] if sampling else None
            self._materials[key] = make_material(self._document, surface.material, image, colors is not None)
        return MeshPart(
            vertices,
            surface.geometry.faces[:, corners],
            self._materials[key],
            None if uv is None else uv[:, corners],
            None if colors is None else colors_as_bytes(colors[:, :3]),
        )


def _check_amount(document: GltfDocument, drawn: Sequence[tuple[_Placed, Sequence[_Surface]]]) -> None:
    """Raise DeuxError if all instances of all triangles are too large for the memory."""
    surfaces = vertices = faces = 0
    for node, placed in drawn:
        with document.reading(f"nodes[{node.index}]"):
            stored = _instance_attributes(node.entry)
            instances = min((document.element("accessors", index)["count"] for index in stored.values()), default=1)
        surfaces += instances * len(placed)
        vertices += instances * sum(len(surface.geometry.attributes["POSITION"]) for surface in placed)
        faces += instances * sum(len(surface.geometry.faces) for surface in placed)
    size = _PART_BYTES * surfaces + _VERTEX_BYTES * vertices + _FACE_BYTES * faces
    check_memory(size, f"{document.path} with {faces:,} triangles in {surfaces:,} placed surfaces", "split the scene")


def _place_nodes(document: GltfDocument) -> dict[int, _Placed]:
    """The nodes of the default scene by their index, with their transforms to the world."""
    with document.reading("its scene"):
        nodes = document.header.get("nodes", [])
        if document.header.get("scenes"):
            roots = document.element("scenes", document.header.get("scene", 0)).get("nodes", [])
        else:
            children = {child for node in nodes for child in node.get("children", ())}
            roots = [index for index in range(len(nodes)) if index not in children]
        placed: dict[int, _Placed] = {}
        waiting = [(index, np.eye(4), True) for index in reversed(roots)]
        while waiting:
            index, parent, visible = waiting.pop()
            if index in placed:
                raise ValueError(f"nodes[{index}] has two parents, but nodes must be a tree")
            entry = document.element("nodes", index)
            visible &= entry.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True)
            world = parent @ _local_transform(entry, index)
            placed[index] = _Placed(index, entry, world, visible)
            waiting += [(child, world, visible) for child in reversed(entry.get("children", []))]
    return placed


def _local_transform(node: dict[str, Any], index: int) -> np.ndarray:
    """A node's 4 x 4 transform to its parent."""
    if "matrix" in node:
        matrix = np.array(node["matrix"], np.float64)
        if matrix.shape != (16,):
            raise ValueError(f"the matrix of nodes[{index}] does not have 16 numbers")
        return matrix.reshape(4, 4).T
    translation, scale = node.get("translation", (0, 0, 0)), node.get("scale", (1, 1, 1))
    rotation = node.get("rotation", (0, 0, 0, 1))
    return _transforms(*(np.array([value], np.float64) for value in (translation, rotation, scale)))[0]


def _transforms(translations: np.ndarray, rotations: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """N x 4 x 4 matrices translation x rotation x scale; rotations are N x 4 quaternions (x, y, z, w)."""
    matrices = np.tile(np.eye(4), (len(translations), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(rotations).as_matrix() * scales[:, None]
    matrices[:, :3, 3] = translations
    return matrices


def _place_vertices(
    document: GltfDocument, nodes: dict[int, _Placed], node: _Placed, geometry: Geometry, vertices: np.ndarray
) -> Iterator[tuple[np.ndarray, bool]]:
    """World vertices of each instance of a node, and whether the instance is mirrored."""
    if "skin" in node.entry and "JOINTS_0" in geometry.attributes:
        yield _skinned(document, nodes, node.entry["skin"], geometry, vertices), False
        return
    for world in node.world @ _instances(document, node.entry):
        yield vertices @ world[:3, :3].T + world[:3, 3], bool(np.linalg.det(world[:3, :3]) < 0)


def _instances(document: GltfDocument, node: dict[str, Any]) -> np.ndarray:
    """Transforms of a node's instances to the node, N x 4 x 4 (EXT_mesh_gpu_instancing); the identity without."""
    stored = _instance_attributes(node)
    if not stored:
        return np.eye(4)[None]
    read = {name: read_accessor(document, index) for name, index in stored.items()}
    count = len(next(iter(read.values())))
    if any(values.shape != (count, len(_IDENTITY[name])) for name, values in read.items()):
        raise ValueError("the attributes of its instances have wrong numbers of values or components")
    return _transforms(
        *(read.get(name, np.tile(np.array(value, np.float64), (count, 1))) for name, value in _IDENTITY.items())
    )


def _instance_attributes(node: dict[str, Any]) -> dict[str, int]:
    """The accessors of the transforms of a node's instances; empty without instancing."""
    stored = node.get("extensions", {}).get(_INSTANCES, {}).get("attributes", {})
    return {name: stored[name] for name in _IDENTITY if name in stored}


def _skinned(
    document: GltfDocument, nodes: dict[int, _Placed], index: int, geometry: Geometry, vertices: np.ndarray
) -> np.ndarray:
    """Skinned vertices: the sum over joints of weight x joint's world transform x inverse bind matrix x vertex."""
    skin = document.element("skins", index)
    missing = [joint for joint in skin["joints"] if joint not in nodes]
    if missing:
        raise ValueError(f"skins[{index}] has the joint nodes[{missing[0]}], which is not in the scene")
    matrices = np.stack([nodes[joint].world for joint in skin["joints"]])
    if "inverseBindMatrices" in skin:
        stored = read_accessor(document, skin["inverseBindMatrices"])
        matrices = matrices @ stored.reshape(-1, 4, 4).transpose(0, 2, 1)[: len(matrices)]
    sets = [name.removeprefix("JOINTS_") for name in geometry.attributes if name.startswith("JOINTS_")]
    joints = np.concatenate([geometry.attributes[f"JOINTS_{number}"] for number in sets], axis=1).astype(np.int64)
    weights = np.concatenate([geometry.attributes[f"WEIGHTS_{number}"] for number in sets], axis=1).astype(np.float64)
    total = weights.sum(axis=1, keepdims=True)
    moved = np.zeros_like(vertices)
    for joint, weight in zip(joints.T, (weights / np.where(total > 0, total, 1)).T, strict=True):
        turned = np.einsum("vij,vj->vi", matrices[joint, :3, :3], vertices) + matrices[joint, :3, 3]
        moved += weight[:, None] * turned
    return moved


def _log_left_out(document: GltfDocument, counted: Counter[str]) -> None:
    """Log what is left out of the file, in one line."""
    scenes = len(document.header.get("scenes") or ())
    left_out = [f"{count} {what}" for what, count in sorted(counted.items())]
    if scenes > 1:
        left_out.append(f"{scenes - 1} other scenes than scenes[{document.header.get('scene', 0)}]")
    if document.header.get("skins"):
        left_out.append("animations of skins")
    if document.unread_extensions:
        left_out.append(f"the optional extensions {', '.join(document.unread_extensions)}")
    if left_out:
        log.info("%s: left out: %s", document.path, "; ".join(left_out))
