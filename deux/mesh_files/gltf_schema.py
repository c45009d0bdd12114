"""Type checks of the JSON of glTF files, once before it is used.

Values of a wrong type raise an error with their place, so that other modules can rely on the types. Whether indices
exist and bytes are within their buffers is checked when they are read. Keys that are not listed here are not used.
Specification: Khronos Group, glTF 2.0 (ISO/IEC 12113:2022), chapter 5.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

from deux.errors import shown

Check = Callable[[Any, str], None]
"""A function of a value and its place that raises ValueError, naming the place, if the value is invalid."""

LONGEST_NAME = 1000
"""Greatest length of names in characters, except for data URIs."""


def check_header(header: Mapping[str, Any]) -> None:
    """Check the types of all used values in the JSON of a glTF file.

    Raises:
        ValueError: a value is invalid; the message names the place, the value and what is expected.
    """
    _HEADER(header, "")


def _is_whole(value: Any, least: int = 0) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and least <= value < 2**53


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= _LARGEST if isinstance(value, int) else math.isfinite(value)


def _simple(matches: Callable[[Any], bool], expected: str) -> Check:
    def check(value: Any, place: str) -> None:
        if not matches(value):
            raise ValueError(f"{place} is {shown(value)}, but must be {expected}")

    return check


def _list(element: Check, least: int = 0, lengths: tuple[int, ...] = ()) -> Check:
    """A list of values, either with one of the given lengths or with at least `least` elements."""

    def check(value: Any, place: str) -> None:
        valid = isinstance(value, list) and (len(value) in lengths if lengths else len(value) >= least)
        if not valid:
            count = " or ".join(map(str, lengths)) if lengths else f"{least} or more" if least else "any number of"
            raise ValueError(f"{place} is {shown(value)}, but must be a list of {count} values")
        for number, item in enumerate(value):
            element(item, f"{place}[{number}]")

    return check


def _object(required: tuple[str, ...] = (), /, **members: Check) -> Check:
    """An object with the given members, some of which are required; other members are ignored."""

    def check(value: Any, place: str) -> None:
        if not isinstance(value, dict):
            raise ValueError(f"{place or 'its JSON'} is {shown(value)}, but must be an object")
        for name in required:
            if name not in value:
                raise ValueError(f"{place or 'its JSON'} has no {name}")
        for name in members.keys() & value.keys():
            members[name](value[name], f"{place}.{name}" if place else name)

    return check


def _map(element: Check) -> Check:
    """An object with any keys, whose values are all checked in the same way."""

    def check(value: Any, place: str) -> None:
        _object()(value, place)
        for name, item in value.items():
            element(item, f"{place}.{name[:50]}")

    return check


_LARGEST = 1e308
_whole = _simple(_is_whole, "a whole number from 0")
_positive = _simple(lambda value: _is_whole(value, 1), "a whole number from 1")
_number = _simple(_is_number, "a number")
_text = _simple(lambda value: isinstance(value, str), "text")
_truth = _simple(lambda value: isinstance(value, bool), "true or false")
_name = _simple(
    lambda value: isinstance(value, str) and len(value) <= LONGEST_NAME, f"text of at most {LONGEST_NAME} characters"
)
_uri = _simple(
    lambda value: isinstance(value, str) and (value.startswith("data:") or len(value) <= LONGEST_NAME),
    f"the name of a file, of at most {LONGEST_NAME} characters, or a data URI",
)
_component = _simple(lambda value: value in (5120, 5121, 5122, 5123, 5125, 5126), "a type of component, 5120 to 5126")
_shape = _simple(
    lambda value: value in ("SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"), "SCALAR, VEC2, ... or MAT4"
)
_numbers = _list(_number)
_indices = _list(_whole)
_names = _list(_name)


def _numbers_of(*lengths: int) -> Check:
    return _list(_number, lengths=lengths)


_TEXTURE_TRANSFORM = _object(offset=_numbers_of(2), scale=_numbers_of(2), rotation=_number, texCoord=_whole)
_TEXTURE_INFO = _object(
    ("index",), index=_whole, texCoord=_whole, extensions=_object(KHR_texture_transform=_TEXTURE_TRANSFORM)
)
_MATERIAL = _object(
    name=_name,
    pbrMetallicRoughness=_object(baseColorFactor=_numbers_of(4), baseColorTexture=_TEXTURE_INFO),
    extensions=_object(
        KHR_materials_pbrSpecularGlossiness=_object(diffuseFactor=_numbers_of(4), diffuseTexture=_TEXTURE_INFO)
    ),
)
_MESHOPT = _object(
    ("buffer", "byteLength", "byteStride", "count", "mode"),
    buffer=_whole,
    byteOffset=_whole,
    byteLength=_whole,
    byteStride=_positive,
    count=_whole,
    mode=_text,
    filter=_text,
)
_BUFFER_VIEW = _object(
    ("buffer", "byteLength"),
    buffer=_whole,
    byteOffset=_whole,
    byteLength=_whole,
    byteStride=_positive,
    extensions=_object(EXT_meshopt_compression=_MESHOPT, KHR_meshopt_compression=_MESHOPT),
)
_SPARSE = _object(
    ("count", "indices", "values"),
    count=_whole,
    indices=_object(("bufferView", "componentType"), bufferView=_whole, byteOffset=_whole, componentType=_component),
    values=_object(("bufferView",), bufferView=_whole, byteOffset=_whole),
)
_ACCESSOR = _object(
    ("componentType", "count", "type"),
    bufferView=_whole,
    byteOffset=_whole,
    componentType=_component,
    normalized=_truth,
    count=_positive,
    type=_shape,
    sparse=_SPARSE,
)
_PRIMITIVE = _object(
    ("attributes",),
    attributes=_map(_whole),
    indices=_whole,
    material=_whole,
    mode=_whole,
    targets=_list(_map(_whole)),
    extensions=_object(
        KHR_draco_mesh_compression=_object(("bufferView", "attributes"), bufferView=_whole, attributes=_map(_whole))
    ),
)
_NODE = _object(
    mesh=_whole,
    skin=_whole,
    children=_indices,
    weights=_numbers,
    matrix=_numbers_of(16),
    translation=_numbers_of(3),
    rotation=_numbers_of(4),
    scale=_numbers_of(3),
    extensions=_object(
        EXT_mesh_gpu_instancing=_object(attributes=_map(_whole)), KHR_node_visibility=_object(visible=_truth)
    ),
)
_TEXTURE = _object(
    source=_whole,
    sampler=_whole,
    extensions=_object(
        EXT_texture_webp=_object(source=_whole),
        EXT_texture_avif=_object(source=_whole),
        KHR_texture_basisu=_object(source=_whole),
    ),
)
_HEADER = _object(
    ("asset",),
    asset=_object(("version",), version=_text, minVersion=_text),
    extensionsUsed=_names,
    extensionsRequired=_names,
    scene=_whole,
    scenes=_list(_object(nodes=_indices)),
    nodes=_list(_NODE),
    meshes=_list(_object(("primitives",), name=_name, weights=_numbers, primitives=_list(_PRIMITIVE))),
    skins=_list(_object(("joints",), joints=_list(_whole, 1), inverseBindMatrices=_whole)),
    materials=_list(_MATERIAL),
    textures=_list(_TEXTURE),
    samplers=_list(_object(wrapS=_whole, wrapT=_whole)),
    images=_list(_object(uri=_uri, bufferView=_whole, mimeType=_name)),
    accessors=_list(_ACCESSOR),
    bufferViews=_list(_BUFFER_VIEW),
    buffers=_list(_object(("byteLength",), uri=_uri, byteLength=_whole)),
)
