"""Materials of glTF 2.0: base colours and base textures as unlit materials, and texture coordinates.

For a material with a black base colour, the emissive colour is used instead: scans with baked lighting are stored so.

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
_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"  # the first bytes of a KTX2 file
_LARGEST_MARGIN = 3.0  # greatest padding of a clamped texture, relative to its size


@dataclass(frozen=True)
class Sampling:
    """An image with its wrap modes.

    Args:
        image: index of the image in the file.
        wraps: CLAMP, MIRROR or REPEAT along u and along v.
    """

    image: int
    wraps: tuple[int, int]


@dataclass(frozen=True)
class BaseTexture:
    """The texture of a material's base colour.

    Args:
        sampling: the image with its wrap modes.
        attribute: the vertex attribute of the texture coordinates, such as "TEXCOORD_0".
        transform: 2 x 3 float64, from these coordinates to those of the image, with (0, 0) at its top left.
    """

    sampling: Sampling
    attribute: str
    transform: np.ndarray


def base_texture(document: GltfDocument, material: int | None) -> BaseTexture | None:
    """The base colour texture of a material; None if it has none.

    Raises:
        ValueError: the file is damaged.
        DeuxError: the texture's image has a format that is not supported.
    """
    described = _base(document, material).get("texture")
    if described is None:
        return None
    texture = document.element("textures", described["index"])
    sampler = document.element("samplers", texture["sampler"]) if "sampler" in texture else {}
    extensions = texture.get("extensions", {})
    # Prefer the image in a standard format over the same image in another format.
    sources = [texture.get("source"), *(extensions.get(name, {}).get("source") for name in TEXTURE_FORMATS)]
    image = next((source for source in sources if source is not None), None)
    if image is None:
        formats = f" except in unsupported formats ({', '.join(extensions)})" if extensions else ""
        place = f"textures[{described['index']}]"
        raise DeuxError(f"{document.path} has no image for {place}{formats}: add a PNG or JPEG.")
    transform = described.get("extensions", {}).get(_TRANSFORM, {})
    texcoord = transform.get("texCoord", described.get("texCoord", 0))
    wraps = (whole_number(sampler, "wrapS", REPEAT), whole_number(sampler, "wrapT", REPEAT))
    document.element("images", image)
    return BaseTexture(Sampling(image, wraps), f"TEXCOORD_{texcoord}", _transform_matrix(transform))


def make_material(
    document: GltfDocument, index: int | None, texture: np.ndarray | None, has_vertex_colors: bool
) -> Material:
    """Make an unlit material.

    Colours are multiplied as stored, as in Habitat-Sim's flat shading, and not in linear light as in the specification.
    Transparency is ignored.

    Args:
        document: the file.
        index: index of the material; None for surfaces without a material.
        texture: its base colour texture, height x width x 3 uint8.
        has_vertex_colors: whether the surface has vertex colours.

    Raises:
        DeuxError: the file is damaged.
    """
    if index is None:
        return Material("colours") if has_vertex_colors else Material("no colours", GREY)
    with document.reading(f"materials[{index}]"):
        name = document.element("materials", index).get("name") or f"material {index}"
        factor = np.asarray(_base(document, index).get("factor", (1, 1, 1, 1)), np.float64)[:3]
        red, green, blue = (int(value) for value in colors_as_bytes(factor))
    return Material(str(name), (red, green, blue), texture)


def colors_as_bytes(colors: np.ndarray) -> np.ndarray:
    """Convert colours in [0, 1] to uint8, rounded and clipped; NaN becomes 0."""
    return np.round(np.clip(np.nan_to_num(colors), 0, 1) * 255).astype(np.uint8)


def decode_images(document: GltfDocument, indices: Iterable[int]) -> dict[int, np.ndarray]:
    """Decode images in parallel: height x width x 3 uint8 by index.

    Raises:
        DeuxError: an image is missing, damaged, or has a format that is not supported.
    """

    def decode(index: int) -> np.ndarray:
        with document.reading(f"images[{index}]"):
            return _decode_image(document, index)

    chosen = sorted(set(indices))
    _check_sizes(document, chosen)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(chosen, pool.map(decode, chosen), strict=True))


class WrappedTexture:
    """A texture that gives the result of other wrap modes when it is repeated.

    A mirrored texture is padded with its mirror image, a clamped one with the colours of its border, if the texture
    coordinates exceed the image.

    Args:
        image: height x width x 3 uint8.
        wraps: CLAMP, MIRROR or REPEAT along u and along v.
        coordinates: the texture coordinates in use, each V x 2 and not empty, with (0, 0) at the top left.
        place: the name of the texture in the log.
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
        """Convert coordinates from the original image to the padded image.

        Args:
            uv: ... x 2, with (0, 0) at the top left of the original image.

        Returns:
            ... x 2 float32, with (0, 0) at the bottom left of the padded image.
        """
        new_sizes = np.array(self.image.shape[1::-1])
        u, v = np.moveaxis((uv * self._sizes + self._before) / new_sizes, -1, 0)
        return np.stack([u, 1 - v], axis=-1).astype(np.float32)


def _margins(size: int, wrap: int, low: float, high: float, place: str) -> tuple[int, int]:
    """Padding before and after a row of `size` pixels, for coordinates from `low` to `high`."""
    tolerance = 0.01 / size  # a hundredth of a pixel, for rounding errors of coordinates
    if wrap not in (CLAMP, MIRROR) or (low >= -tolerance and high <= 1 + tolerance):
        return 0, 0
    if wrap == MIRROR:
        return 0, size
    limit = int(_LARGEST_MARGIN * size)
    before, after = (max(beyond, 0.0) * size for beyond in (-low, high - 1))
    if before + after > limit:
        log.warning("%s is clamped, but its coordinates far exceed the image: it is repeated there", place)
    before = min(math.ceil(before), limit)
    return before, min(math.ceil(after), limit - before)


def _base(document: GltfDocument, index: int | None) -> dict[str, Any]:
    """The base colour of a material, or its emissive colour if that is black: "factor" and "texture", if given."""
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
    """The matrix translation x rotation x scale of KHR_texture_transform, 2 x 3; rotation is from u towards -v."""
    (offset_u, offset_v), (scale_u, scale_v) = transform.get("offset", (0, 0)), transform.get("scale", (1, 1))
    cos, sin = math.cos(transform.get("rotation", 0)), math.sin(transform.get("rotation", 0))
    return np.array([[cos * scale_u, sin * scale_v, offset_u], [-sin * scale_u, cos * scale_v, offset_v]])


def _decode_image(document: GltfDocument, index: int) -> np.ndarray:
    content = document.image_bytes(index)
    if _is_ktx2(document, index, content):
        return _decode_ktx2(document, index, content)
    with _open(content) as image:
        if image.mode.startswith("I"):
            # Use the upper 8 of 16 bits, as Pillow does for 16-bit colours.
            grey = (np.asarray(image).astype(np.int64) >> 8).clip(0, 255).astype(np.uint8)
            return np.repeat(grey[..., None], 3, axis=2)
        # Pillow would warn about a palette's transparency if it were converted directly.
        converted = image.convert("RGBA") if image.mode in ("P", "PA") else image
        return np.asarray(converted if converted.mode == "RGB" else converted.convert("RGB"))


def _check_sizes(document: GltfDocument, indices: Sequence[int]) -> None:
    """Raise DeuxError if the images, by their headers, are too large for the memory in total."""
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
    """Open an image of any format that Pillow supports."""
    try:
        return open_image(io.BytesIO(content), "an image", TEXTURE_BYTES)
    except UnidentifiedImageError as error:
        raise ValueError("it is not a PNG, JPEG, WebP or other image that Pillow supports") from error


def _decode_ktx2(document: GltfDocument, index: int, content: bytes) -> np.ndarray:
    """Decode a KTX2 image with Basis Universal compression."""
    basis = document.optional_package(
        "opengl_basisu",
        "Basis Universal (KTX2) textures",
        ", or use its JPEG or PNG version (for HM3D the archive _glb)",
    )
    try:
        pixels = basis.open(content).transcode("rgba8").data
    except Exception as error:
        raise DeuxError(
            f"{document.path} has a KTX2 texture, images[{index}], that cannot be decoded: it is damaged or not "
            f"compressed with Basis Universal ({error})."
        ) from error
    return np.ascontiguousarray(pixels[..., :3])
