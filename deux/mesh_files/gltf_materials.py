"""The appearance of glTF 2.0: base colours and base textures as unlit materials, and where textures lie on triangles.

Of a material whose base colour is black it is what it emits: scans with the light in their pictures are stored so.

Specification: Khronos Group, glTF 2.0 (ISO/IEC 12113:2022), sections 3.8 and 3.9; KHR_texture_transform,
KHR_materials_pbrSpecularGlossiness, KHR_materials_unlit, KHR_texture_basisu, EXT_texture_webp.
"""

import io
import logging
import math
import os
import struct
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError

from deux.contracts import Material
from deux.errors import DeuxError, counted
from deux.io.image_opening import TEXTURE_BYTES, open_image
from deux.memory_budget import check_memory
from deux.mesh_files.gltf_document import TEXTURE_FORMATS, GltfDocument, whole_number
from deux.mesh_files.mesh_parts import GREY

log = logging.getLogger(__name__)

CLAMP, MIRROR, REPEAT = 33071, 33648, 10497
_SPECULAR = "KHR_materials_pbrSpecularGlossiness"
_UNLIT = "KHR_materials_unlit"
_TRANSFORM = "KHR_texture_transform"
_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"  # the first bytes of such a file
_LARGEST_MARGIN = 3.0  # of a clamped texture, as a part of its own size


@dataclass(frozen=True)
class Sampling:
    """An image and how it goes on beyond its borders.

    Args:
        image: its index in the file.
        wraps: CLAMP, MIRROR or REPEAT along u and along v.
    """

    image: int
    wraps: tuple[int, int]


@dataclass(frozen=True)
class BaseTexture:
    """The texture of a material's base colour.

    Args:
        sampling: its image.
        attribute: the vertices' attribute of its coordinates, such as "TEXCOORD_0".
        transform: 2 x 3 float64, from these coordinates to those of the image, (0, 0) at its top left.
    """

    sampling: Sampling
    attribute: str
    transform: np.ndarray


def base_texture(document: GltfDocument, material: int | None) -> BaseTexture | None:
    """The texture of the base colour of a material; None if it has none.

    Raises:
        ValueError: the file is damaged here.
        DeuxError: the texture's image is in a form that is not read.
    """
    described = _base(document, material).get("texture")
    if described is None:
        return None
    texture = document.element("textures", described["index"])
    sampler = document.element("samplers", texture["sampler"]) if "sampler" in texture else {}
    extensions = texture.get("extensions", {})
    # An image that every reader reads goes before the same in another format.
    sources = [texture.get("source"), *(extensions.get(name, {}).get("source") for name in TEXTURE_FORMATS)]
    image = next((source for source in sources if source is not None), None)
    if image is None:
        forms = f" but in a form that is not read ({', '.join(extensions)})" if extensions else ""
        raise DeuxError(f"{document.path} names no image for textures[{described['index']}]{forms}: add a PNG or JPEG.")
    transform = described.get("extensions", {}).get(_TRANSFORM, {})
    texcoord = transform.get("texCoord", described.get("texCoord", 0))
    wraps = (whole_number(sampler, "wrapS", REPEAT), whole_number(sampler, "wrapT", REPEAT))
    document.element("images", image)
    return BaseTexture(Sampling(image, wraps), f"TEXCOORD_{texcoord}", _transform_matrix(transform))


def make_material(
    document: GltfDocument, index: int | None, texture: np.ndarray | None, has_vertex_colors: bool
) -> Material:
    """A material without light; factors are multiplied as they are stored, as Habitat-Sim's flat shading does.

    The specification multiplies in linear light; transparency is ignored.

    Args:
        document: the file.
        index: of the material; None for the surfaces of no material.
        texture: its base texture, height x width x 3 uint8.
        has_vertex_colors: whether the surface has colours of its own.

    Raises:
        DeuxError: the file is damaged here.
    """
    if index is None:
        return Material("colours") if has_vertex_colors else Material("no colours", GREY)
    with document.reading(f"materials[{index}]"):
        name = document.element("materials", index).get("name") or f"material {index}"
        factor = np.asarray(_base(document, index).get("factor", (1, 1, 1, 1)), np.float64)[:3]
        red, green, blue = (int(value) for value in colors_as_bytes(factor))
    return Material(str(name), (red, green, blue), texture)


def colors_as_bytes(colors: np.ndarray) -> np.ndarray:
    """Colours from 0 to 1 as uint8, rounded; what lies beyond is clipped, NaN is 0."""
    return np.round(np.clip(np.nan_to_num(colors), 0, 1) * 255).astype(np.uint8)


def decode_images(document: GltfDocument, indices: Iterable[int]) -> dict[int, np.ndarray]:
    """The images of some indices, decoded at the same time on all cores: height x width x 3 uint8 by index.

    Raises:
        DeuxError: one is missing, damaged, or in a format that is not read.
    """

    def decode(index: int) -> np.ndarray:
        with document.reading(f"images[{index}]"):
            return _decode_image(document, index)

    chosen = sorted(set(indices))
    _check_sizes(document, chosen)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(chosen, pool.map(decode, chosen), strict=True))


class WrappedTexture:
    """A texture that, repeated, looks as its sampler's wrap modes say over a range of coordinates.

    A mirrored texture is doubled by its mirror image, a clamped one is enlarged by its border's colours. That is done
    only where coordinates leave the image.

    Args:
        image: height x width x 3 uint8.
        wraps: CLAMP, MIRROR or REPEAT along u and along v.
        coordinates: those in use, each V x 2, (0, 0) at the top left; none is empty.
        place: what the texture is called in the log.
    """

    def __init__(
        self, image: np.ndarray, wraps: tuple[int, int], coordinates: Sequence[np.ndarray], place: str
    ) -> None:
        low = np.min([uv.min(axis=0) for uv in coordinates], axis=0)
        high = np.max([uv.max(axis=0) for uv in coordinates], axis=0)
        sizes = image.shape[1], image.shape[0]
        margins = [_margins(*axis, place) for axis in zip(sizes, wraps, low, high, strict=True)]
        for axis, (margin, wrap) in enumerate(zip(margins, wraps, strict=True)):
            if any(margin):
                widths = [(0, 0), (0, 0), (0, 0)]
                widths[1 - axis] = margin
                image = np.pad(image, widths, mode="symmetric" if wrap == MIRROR else "edge")
        self.image = image
        self._before = np.array([before for before, _ in margins])
        self._sizes = np.array(sizes)

    def coordinates(self, uv: np.ndarray) -> np.ndarray:
        """Coordinates in the original image, (0, 0) at the top left, as float32 in this one, (0, 0) at the bottom left.

        Args:
            uv: ... x 2.
        """
        new_sizes = np.array(self.image.shape[1::-1])
        u, v = np.moveaxis((uv * self._sizes + self._before) / new_sizes, -1, 0)
        return np.stack([u, 1 - v], axis=-1).astype(np.float32)


def _margins(size: int, wrap: int, low: float, high: float, place: str) -> tuple[int, int]:
    """Pixels to add before and after a row of `size` pixels so that it can be repeated."""
    hidden = 0.01 / size  # a hundredth of a pixel is the rounding of coordinates
    if wrap not in (CLAMP, MIRROR) or (low >= -hidden and high <= 1 + hidden):
        return 0, 0
    if wrap == MIRROR:
        return 0, size
    limit = int(_LARGEST_MARGIN * size)
    before, after = (max(beyond, 0.0) * size for beyond in (-low, high - 1))
    if before + after > limit:
        log.warning("%s is clamped, but used far beyond its borders: it repeats there", place)
    before = min(math.ceil(before), limit)
    return before, min(math.ceil(after), limit - before)


def _base(document: GltfDocument, index: int | None) -> dict[str, Any]:
    """The base colour of a material, or what it emits where that is black: "factor" and "texture", if given."""
    if index is None:
        return {}
    material = document.element("materials", index)
    extensions = material.get("extensions", {})
    specular = extensions.get(_SPECULAR)
    described = material.get("pbrMetallicRoughness", {}) if specular is None else specular
    keys = ("baseColorFactor", "baseColorTexture") if specular is None else ("diffuseFactor", "diffuseTexture")
    factor = np.asarray(described.get(keys[0], (1, 1, 1, 1)), np.float64)[:3]
    if "emissiveFactor" in material and _UNLIT not in extensions and not factor.any():
        described, keys = material, ("emissiveFactor", "emissiveTexture")
    return {short: described[key] for short, key in zip(("factor", "texture"), keys, strict=True) if key in described}


def _transform_matrix(transform: dict[str, Any]) -> np.ndarray:
    """translation x rotation x scale of KHR_texture_transform, 2 x 3; a rotation turns u towards -v."""
    (offset_u, offset_v), (scale_u, scale_v) = transform.get("offset", (0, 0)), transform.get("scale", (1, 1))
    cos, sin = math.cos(transform.get("rotation", 0)), math.sin(transform.get("rotation", 0))
    return np.array([[cos * scale_u, sin * scale_v, offset_u], [-sin * scale_u, cos * scale_v, offset_v]])


def _decode_image(document: GltfDocument, index: int) -> np.ndarray:
    content = document.image_bytes(index)
    if _is_ktx2(document, index, content):
        return _decode_ktx2(document, index, content)
    with _open(content) as image:
        if image.mode.startswith("I"):
            # 16 bits: the upper eight, as Pillow itself takes of 16-bit colours.
            grey = (np.asarray(image).astype(np.int64) >> 8).clip(0, 255).astype(np.uint8)
            return np.repeat(grey[..., None], 3, axis=2)
        # Pillow warns unless a palette with transparency is first turned to colours with transparency.
        through = image.convert("RGBA") if image.mode in ("P", "PA") else image
        return np.asarray(through if through.mode == "RGB" else through.convert("RGB"))


def _check_sizes(document: GltfDocument, indices: Sequence[int]) -> None:
    """Refuse images that together take more memory than there is for them, by what their headers say."""
    pixels = 0
    for index in indices:
        with document.reading(f"images[{index}]"):
            content = document.image_bytes(index)
            if _is_ktx2(document, index, content):
                width, height = struct.unpack("<2I", content[20:28].ljust(8, b"\0"))
            else:
                with _open(content) as image:
                    width, height = image.size
            pixels += width * max(height, 1)
    what = f"{document.path} with its {counted(len(indices), 'image')} of {pixels:,} pixels in all"
    check_memory(TEXTURE_BYTES * pixels, what, "make them smaller")


def _is_ktx2(document: GltfDocument, index: int, content: bytes) -> bool:
    entry = document.element("images", index)
    named = entry.get("mimeType") == "image/ktx2" or entry.get("uri", "").lower().endswith(".ktx2")
    return content.startswith(_KTX2) or (named and not content.startswith((b"\x89PNG", b"\xff\xd8", b"RIFF")))


def _open(content: bytes) -> Image.Image:
    """An image of any format."""
    try:
        return open_image(io.BytesIO(content), "an image", TEXTURE_BYTES)
    except UnidentifiedImageError as error:
        raise ValueError("it is no PNG, JPEG, WebP or other image that Pillow reads") from error


def _decode_ktx2(document: GltfDocument, index: int, content: bytes) -> np.ndarray:
    """A KTX2 image with Basis Universal's compression."""
    basis = document.optional_package(
        "opengl_basisu",
        "Basis Universal (KTX2) textures",
        ", or take its JPEG or PNG version (of HM3D the archive _glb)",
    )
    try:
        pixels = basis.open(content).transcode("rgba8").data
    except Exception as error:
        raise DeuxError(
            f"{document.path} has a KTX2 texture, images[{index}], that cannot be decoded, it is damaged or not in "
            f"Basis Universal's format: {error}."
        ) from error
    return np.ascontiguousarray(pixels[..., :3])
