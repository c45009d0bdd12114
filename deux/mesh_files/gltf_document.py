"""The container of glTF 2.0 files: the JSON of a .gltf or .glb file, and the bytes of buffers, views and images.

Specification: Khronos Group, glTF 2.0 (ISO/IEC 12113:2022), chapters 2 to 4 and section 3.6.1.
"""

import base64
import contextlib
import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from deux.errors import DeuxError
from deux.io.file_names import is_within
from deux.io.json_files import decode_json
from deux.memory_budget import check_memory
from deux.mesh_files.gltf_schema import check_header

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
TEXTURE_FORMATS = ("EXT_texture_webp", "EXT_texture_avif", "KHR_texture_basisu")

_READ = {
    *MESHOPT,
    *TEXTURE_FORMATS,
    "EXT_mesh_gpu_instancing",
    "KHR_draco_mesh_compression",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
}

# Extensions for lighting, reflections, cameras or variants, which an unlit default view does not need.
_LIGHT = {
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_xmp_json_ld",
}

_JSON, _BIN = b"JSON", b"BIN\0"  # types of chunks


class GltfDocument:
    """A glTF file: its JSON objects by kind and index, and the bytes that they refer to, read on first use.

    For damaged content methods may raise any exception, mostly ValueError; `reading` converts it to a DeuxError.

    Args:
        path: a .gltf or .glb file; the format is detected by the content.

    Raises:
        DeuxError: the file is missing or damaged, is not glTF 2.x, or requires an extension that is not supported.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._chunk: np.ndarray | None = None
        self._buffers: dict[int, np.ndarray] = {}
        self._views: dict[int, np.ndarray] = {}
        with self.reading("its header"):
            self.header: dict[str, Any] = decode_json(self._split_chunks().tobytes(), path)
            check_header(self.header)
            version = self.header["asset"].get("minVersion", self.header["asset"]["version"])
            required = set(self.header.get("extensionsRequired", ()))
        if not version.startswith("2."):
            raise DeuxError(f"{path} has version {version} of glTF: convert it to version 2, which is supported.")
        unknown = sorted(required - _READ - _LIGHT)
        if unknown:
            raise DeuxError(
                f"{path} requires the glTF extension {', '.join(unknown)}, which is not supported: export it without "
                "this extension."
            )

    @property
    def unread_extensions(self) -> list[str]:
        """Names of the optional extensions that are not supported, except those for lighting."""
        return sorted(set(self.header.get("extensionsUsed", ())) - _READ - _LIGHT)

    def requires(self, extension: str) -> bool:
        """Whether the file requires an extension."""
        return extension in self.header.get("extensionsRequired", ())

    @contextlib.contextmanager
    def reading(self, place: str) -> Iterator[None]:
        """Convert any exception of the body to a DeuxError that names the file and the place.

        Args:
            place: the part of the file that is read, such as "meshes[0].primitives[1]".
        """
        try:
            yield
        except DeuxError:
            raise
        except Exception as error:  # NumPy, Pillow and the decoders raise many kinds of errors
            if isinstance(error, OSError) and error.filename is not None:
                raise DeuxError(f"{error.filename} cannot be read: {error.strerror}.") from error
            fault = f"there is no {error.args[0]}" if isinstance(error, KeyError) else str(error).rstrip(".")
            fault = fault or type(error).__name__
            kind = self.path.suffix or "glTF"
            raise DeuxError(f"{self.path} cannot be read as a {kind} file, {place} is damaged: {fault}.") from error

    def element(self, kind: str, index: int) -> dict[str, Any]:
        """An object of one of the top-level lists.

        Args:
            kind: the list, such as "accessors".
            index: which of its elements.

        Raises:
            ValueError: there is no such element.
        """
        elements = self.header.get(kind, [])
        if not 0 <= index < len(elements):
            raise ValueError(f"it refers to {kind}[{index}], but there are {len(elements)} {kind}")
        return elements[index]

    def view(self, index: int) -> np.ndarray:
        """The decompressed bytes of a buffer view, N uint8.

        Raises:
            ValueError: it exceeds its buffer, or cannot be decompressed.
        """
        if index not in self._views:
            entry = self.element("bufferViews", index)
            compression = self._compression(entry)
            if compression is None:
                self._views[index] = self._bytes(entry, f"bufferViews[{index}]")
            else:
                self._views[index] = self._decompressed(compression, f"bufferViews[{index}]")
        return self._views[index]

    def view_stride(self, index: int) -> int | None:
        """Stride in bytes between the elements of a buffer view; None if they are tightly packed."""
        entry = self.element("bufferViews", index)
        compression = self._compression(entry) or {}
        implied = compression.get("byteStride") if compression.get("mode") == "ATTRIBUTES" else None
        return whole_number(entry, "byteStride", implied) if "byteStride" in entry else implied

    def image_bytes(self, index: int) -> bytes:
        """The encoded content of an image."""
        entry = self.element("images", index)
        if "uri" in entry:
            return self._resource(entry["uri"]).tobytes()
        return self.view(entry["bufferView"]).tobytes()

    def file_name(self, uri: str) -> str | None:
        """The file that a URI refers to, relative to the folder of the glTF file; None for a data URI.

        By the specification names are percent-encoded. Since they often are not, the literal name is used if there is
        no file with the decoded name. Backslashes are treated as slashes.

        Raises:
            DeuxError: it refers to a server, or to a file outside of the folder.
        """
        if uri.startswith("data:"):
            return None
        if "://" in uri:
            raise DeuxError(f"{self.path} refers to the address {uri}: download it to the same folder.")
        literal, decoded = (name.replace("\\", "/") for name in (uri, unquote(uri)))
        folder = self.path.parent
        name = literal if not os.path.isfile(folder / decoded) and os.path.isfile(folder / literal) else decoded
        if not is_within(name):
            raise DeuxError(
                f"{self.path} refers to {name}, which is outside of its folder: only files in {folder} are read, store "
                "it there."
            )
        return name

    def optional_package(self, name: str, what: str, otherwise: str = "") -> ModuleType:
        """Import a package of the extra `compressed`.

        Args:
            name: name of the module.
            what: the part of the file that needs it, for the message.
            otherwise: another remedy, for the message.

        Raises:
            DeuxError: the package is not installed.
        """
        try:
            return importlib.import_module(name)
        except ImportError as error:
            raise DeuxError(
                f'{self.path} has {what}, which need the package {name}: pip install "deux[compressed]"{otherwise}.'
            ) from error

    def _split_chunks(self) -> np.ndarray:
        """The bytes of the JSON; stores the first binary chunk of a .glb file."""
        data = _file_bytes(self.path)
        if data[:4].tobytes() != b"glTF":
            if not data[:64].tobytes().lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
                raise DeuxError(f"{self.path} is not a {self.path.suffix} file: it does not begin like one.")
            return data
        if len(data) < 20:
            raise DeuxError(f"{self.path} is truncated to {len(data)} bytes.")
        version, length = (int(value) for value in data[4:12].view("<u4"))
        if version != 2:
            raise ValueError(f"it is version {version} of the .glb format, not 2")
        if len(data) < length:
            raise DeuxError(f"{self.path} is truncated to {len(data)} of {length} bytes.")
        chunks: dict[bytes, np.ndarray] = {}
        start = 12
        while start + 8 <= length:
            size, kind = int(data[start : start + 4].view("<u4")[0]), data[start + 4 : start + 8].tobytes()
            if start + 8 + size > length:
                raise ValueError(f"a chunk of {size} bytes at byte {start} ends beyond its {length} bytes")
            chunks.setdefault(kind, data[start + 8 : start + 8 + size])
            start += 8 + size
        self._chunk = chunks.get(_BIN)
        return chunks[_JSON]

    def _resource(self, uri: str) -> np.ndarray:
        """The bytes behind a URI."""
        name = self.file_name(uri)
        if name is None:
            return np.frombuffer(_data_uri_bytes(uri), np.uint8)
        if not os.path.isfile(self.path.parent / name):
            folder = self.path.parent
            raise DeuxError(f"{self.path} needs {name}, which is not in {folder}: the two must be kept together.")
        return _file_bytes(self.path.parent / name)

    def _buffer(self, index: int) -> np.ndarray:
        if index not in self._buffers:
            entry = self.element("buffers", index)
            if "uri" in entry:
                data = self._resource(entry["uri"])
            elif index == 0 and self._chunk is not None:
                data = self._chunk
            else:
                raise ValueError(f"buffers[{index}] has neither a uri nor a binary chunk")
            length = whole_number(entry, "byteLength")
            if len(data) < length:
                raise ValueError(f"buffers[{index}] is truncated to {len(data)} of {length} bytes")
            self._buffers[index] = data[:length]
        return self._buffers[index]

    def _bytes(self, entry: dict[str, Any], place: str) -> np.ndarray:
        """The bytes that the buffer, offset and length of a buffer view, or its compressed form, refer to."""
        data = self._buffer(entry["buffer"])
        offset, length = whole_number(entry, "byteOffset", 0), whole_number(entry, "byteLength")
        if offset + length > len(data):
            end = offset + length
            raise ValueError(f"{place} ends at byte {end} of buffers[{entry['buffer']}], which has {len(data)}")
        return data[offset : offset + length]

    def _compression(self, entry: dict[str, Any]) -> dict[str, Any] | None:
        """The description of a buffer view's compressed content; None if its uncompressed content is available."""
        name = next((name for name in MESHOPT if name in entry.get("extensions", {})), None)
        if name is None:
            return None
        plain = self.element("buffers", entry["buffer"])
        has_plain = "uri" in plain or (entry["buffer"] == 0 and self._chunk is not None)
        return None if has_plain and not self.requires(name) else entry["extensions"][name]

    def _decompressed(self, compression: dict[str, Any], place: str) -> np.ndarray:
        meshopt = self.optional_package("meshopt", "meshopt-compressed geometry")
        data = self._bytes(compression, f"the compressed content of {place}").tobytes()
        count, stride = whole_number(compression, "count"), whole_number(compression, "byteStride")
        check_memory(2 * count * stride, f"{self.path}: {place}, decompressed,", "split the scene")
        mode, encoding = compression["mode"], compression.get("filter", "NONE")
        try:
            decoded = meshopt.decode_gltf_buffer(data, count, stride, mode, encoding)
        except Exception as error:
            raise ValueError(f"meshopt cannot decode {place}: {error}") from error
        return np.ascontiguousarray(decoded).reshape(-1).view(np.uint8)


def whole_number(entry: dict[str, Any], key: str, default: int | None = None) -> int:
    """A non-negative integer of a JSON object.

    Args:
        entry: the object.
        key: the key.
        default: the value if the key is missing; None if it is required.

    Raises:
        ValueError: the value is not a non-negative integer.
    """
    value = entry[key] if default is None else entry.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or value < 0 or value != int(value):
        raise ValueError(f"{key} is {value}, but must be a whole number from 0")
    return int(value)


def _file_bytes(path: Path) -> np.ndarray:
    """The content of a file, N uint8, memory-mapped."""
    if os.path.exists(path) and not os.path.isfile(path):
        raise DeuxError(f"{path} cannot be read: it is a folder, a pipe or a device where a file is expected.")
    if path.stat().st_size == 0:
        raise ValueError(f"{path.name} is empty")
    return np.asarray(np.memmap(path, np.uint8, "r"))


def _data_uri_bytes(uri: str) -> bytes:
    """The content of a data URI, base64 or percent-encoded (RFC 2397)."""
    described, comma, text = uri.partition(",")
    if not comma:
        raise ValueError("a data URI has no comma before its data")
    content = unquote_to_bytes(text)
    # Padding is optional in practice; too much padding is ignored.
    return base64.b64decode(content + b"==") if described.endswith(";base64") else content
