"""The geometry of glTF 2.0 primitives: accessors, Draco compression, morph targets and primitive modes.

Specification: Khronos Group, glTF 2.0 (ISO/IEC 12113:2022), sections 3.6.2 and 3.7.2.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deux.memory_budget import check_memory
from deux.mesh_files.gltf_document import GltfDocument, whole_number

TRIANGLES, STRIP, FAN = 4, 5, 6
SURFACES = (TRIANGLES, STRIP, FAN)
"""Primitive modes with triangles; the others are points and lines."""

_DRACO = "KHR_draco_mesh_compression"
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS_AND_ROWS = {
    "SCALAR": (1, 1), "VEC2": (1, 2), "VEC3": (1, 3), "VEC4": (1, 4), "MAT2": (2, 2), "MAT3": (3, 3), "MAT4": (4, 4)
}  # fmt: skip
_WIDTHS = {"POSITION": (3,), "TEXCOORD": (2,), "COLOR": (3, 4), "JOINTS": (4,), "WEIGHTS": (4,)}


@dataclass(frozen=True)
class Geometry:
    """The triangles of a primitive.

    Args:
        faces: F x 3 int64, indices of vertices; all vertices are used.
        attributes: vertex attributes by semantic, such as "POSITION", each V x components.
    """

    faces: np.ndarray
    attributes: dict[str, np.ndarray]


def read_geometry(
    document: GltfDocument, primitive: dict[str, Any], names: Iterable[str], weights: Sequence[float] = ()
) -> Geometry:
    """Read a primitive with triangles.

    Args:
        document: the file.
        primitive: the JSON of the primitive.
        names: semantics of the attributes to read; missing ones are left out.
        weights: weights of the morph targets, which are added to the attributes.

    Raises:
        ValueError: the file is damaged.
    """
    stored = primitive["attributes"]
    names = [name for name in names if name in stored]
    draco = primitive.get("extensions", {}).get(_DRACO)
    if draco and (document.requires(_DRACO) or "bufferView" not in document.element("accessors", stored["POSITION"])):
        indices, attributes = _decode_draco(document, draco, stored, names)
    else:
        attributes = {name: read_accessor(document, stored[name], name.startswith("COLOR")) for name in names}
        count = len(attributes["POSITION"])
        indices = _indices(document, primitive["indices"]) if "indices" in primitive else np.arange(count)
    for name, values in attributes.items():
        _check_shape(name, values, len(attributes["POSITION"]))
    _add_targets(document, attributes, primitive.get("targets", ()), weights)
    faces = _faces(indices, TRIANGLES if draco else primitive.get("mode", TRIANGLES))
    return _without_unused(faces, attributes)


def read_accessor(document: GltfDocument, index: int, normalise: bool = False) -> np.ndarray:
    """Read the values of an accessor.

    Args:
        document: the file.
        index: index of the accessor.
        normalise: whether to normalise integers even if the accessor is not normalised.

    Returns:
        count x components; matrices are column-major. Normalised integers are float64 in [0, 1] or [-1, 1], other
        values have their stored type.

    Raises:
        ValueError: the accessor is damaged or exceeds its buffer view.
    """
    accessor = document.element("accessors", index)
    columns, rows = _COLUMNS_AND_ROWS[accessor["type"]]
    dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
    count = whole_number(accessor, "count")
    place = f"accessors[{index}]"
    if "bufferView" in accessor:
        values = _strided(document, accessor, dtype, (count, columns, rows), place)
    else:
        size = count * columns * rows * 8
        check_memory(3 * size, f"{document.path}: accessors[{index}], of {count:,} elements,", "split the scene")
        values = np.zeros((count, columns, rows), dtype)
    if "sparse" in accessor:
        values = _with_sparse(document, accessor["sparse"], values, place)
    values = values.reshape(count, columns * rows)
    return _normalised(values) if accessor.get("normalized") or normalise else values


def _strided(
    document: GltfDocument, entry: dict[str, Any], dtype: np.dtype, shape: tuple[int, int, int], place: str
) -> np.ndarray:
    """A read-only view of count x columns x rows values in a buffer view."""
    index = entry["bufferView"]
    data = document.view(index)
    count, columns, rows = shape
    # The columns of a matrix are aligned to four bytes (section 3.6.2.4).
    column = rows * dtype.itemsize if columns == 1 else -(-rows * dtype.itemsize // 4) * 4
    element = columns * column
    stride = document.view_stride(index) or element
    offset = whole_number(entry, "byteOffset", 0)
    # The last column needs no padding.
    end = offset + (count - 1) * stride + element - (column - rows * dtype.itemsize) if count else offset
    if end > len(data):
        raise ValueError(f"{place} ends at byte {end} of bufferViews[{index}], which has {len(data)}")
    return np.ndarray(shape, dtype, np.ascontiguousarray(data), offset, (stride, column, dtype.itemsize))


def _with_sparse(document: GltfDocument, sparse: dict[str, Any], values: np.ndarray, place: str) -> np.ndarray:
    """A copy of an accessor's values with the sparse values replaced."""
    count = whole_number(sparse, "count")
    described = sparse["indices"]
    index_type = np.dtype(_COMPONENTS[described["componentType"]])
    indices = _strided(document, described, index_type, (count, 1, 1), f"{place}.sparse.indices").reshape(-1)
    replaced = _strided(document, sparse["values"], values.dtype, (count, *values.shape[1:]), f"{place}.sparse.values")
    if count and indices.max() >= len(values):
        raise ValueError(f"{place}.sparse has the index {indices.max()}, but there are {len(values)} values")
    values = values.copy()
    values[indices] = replaced
    return values


def _normalised(values: np.ndarray) -> np.ndarray:
    """Convert integers to fractions of their type's largest value (section 3.6.2.2); floats stay unchanged."""
    if values.dtype.kind == "f":
        return values
    return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)


def _indices(document: GltfDocument, index: int) -> np.ndarray:
    indices = read_accessor(document, index)
    if indices.dtype.kind != "u" or indices.shape[1] != 1:
        raise ValueError(f"accessors[{index}] are not indices: these must be unsigned scalars")
    return indices.reshape(-1).astype(np.int64)


def _check_shape(name: str, values: np.ndarray, count: int) -> None:
    if values.shape[1] not in _WIDTHS[name.split("_")[0]]:
        raise ValueError(f"its {name} has {values.shape[1]} components")
    if len(values) != count:
        raise ValueError(f"its {name} has {len(values)} values for {count} vertices")


def _decode_draco(
    document: GltfDocument, draco: dict[str, Any], stored: dict[str, int], names: Iterable[str]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Indices and attributes of a Draco-compressed primitive; attributes that are not compressed are read as usual."""
    package = document.optional_package("DracoPy", "Draco-compressed geometry")
    content = document.view(draco["bufferView"]).tobytes()
    try:
        mesh = package.decode(content)
        decoded = {attribute["unique_id"]: attribute["data"] for attribute in mesh.attributes}
        indices = np.asarray(mesh.faces).reshape(-1).astype(np.int64)
    except Exception as error:
        raise ValueError(f"Draco cannot decode bufferViews[{draco['bufferView']}]: {error}") from error
    attributes = {}
    for name in names:
        normalise = name.startswith("COLOR") or bool(document.element("accessors", stored[name]).get("normalized"))
        if name in draco["attributes"]:
            values = decoded[draco["attributes"][name]]
            attributes[name] = _normalised(values) if normalise else values
        else:
            attributes[name] = read_accessor(document, stored[name], normalise)
    return indices, attributes


def _add_targets(
    document: GltfDocument,
    attributes: dict[str, np.ndarray],
    targets: Sequence[dict[str, int]],
    weights: Sequence[float],
) -> None:
    """Add weighted morph targets: value = base + sum of weight x displacement (section 3.7.2.2)."""
    for target, weight in zip(targets, weights, strict=False):
        for name in target.keys() & attributes.keys():
            if weight:
                displacement = read_accessor(document, target[name])
                _check_shape(name, displacement, len(attributes[name]))
                attributes[name] = attributes[name] + float(weight) * displacement.astype(np.float64)


def _faces(indices: np.ndarray, mode: int) -> np.ndarray:
    """Convert indices to triangles, F x 3, with the orientation of section 3.7.2.1."""
    if mode == TRIANGLES:
        if len(indices) % 3:
            raise ValueError(f"it has {len(indices)} corners of triangles, which is not a multiple of 3")
        return indices.reshape(-1, 3)
    if len(indices) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == FAN:
        return np.stack([indices[1:-1], indices[2:], np.full(len(indices) - 2, indices[0])], axis=1)
    faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    faces[1::2] = faces[1::2][:, [0, 2, 1]]
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]  # strips are joined by degenerate triangles


def _without_unused(faces: np.ndarray, attributes: dict[str, np.ndarray]) -> Geometry:
    """Remove unused vertices: primitives often share a vertex buffer of which each uses a part."""
    count = len(attributes["POSITION"])
    if len(faces) and faces.max() >= count:
        raise ValueError(f"it has the index {faces.max()}, but {count} vertices")
    used = np.zeros(count, bool)
    used[faces] = True
    if used.all():
        return Geometry(faces, attributes)
    return Geometry((np.cumsum(used) - 1)[faces], {name: values[used] for name, values in attributes.items()})
