"""Writes glTF files for several tests."""

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

COMPONENT_TYPES = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
VECTORS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class GltfWriter:
    """Writes glTF files of one mesh, step by step; `header` is the JSON, to be changed as a test likes.

    Args:
        folder: where files are written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.content = bytearray()
        self.header: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": []}],
            "accessors": [],
            "bufferViews": [],
        }

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Add an object to a list of the header; its index."""
        self.header.setdefault(kind, []).append(entry)
        return len(self.header[kind]) - 1

    def view(self, content: bytes, **more: Any) -> int:
        """Add a buffer view; its index."""
        self.content += bytes(-len(self.content) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.content), "byteLength": len(content), **more}
        self.content += content
        return self.add("bufferViews", entry)

    def accessor(self, values: np.ndarray, **more: Any) -> int:
        """Add the accessor of an array, N or N x components, packed to elements of whole four bytes; its index."""
        values = np.asarray(values)
        rows = values[:, None] if values.ndim == 1 else values
        if values.ndim == 2 and rows.dtype.itemsize * rows.shape[1] % 4:
            size = rows.dtype.itemsize * rows.shape[1]
            stride = size + -size % 4
            packed = b"".join(row.tobytes() + bytes(stride - size) for row in rows)
            view = self.view(packed, byteStride=stride)
        else:
            view = self.view(rows.tobytes())
        described = {"componentType": COMPONENT_TYPES[values.dtype.name], "type": VECTORS[rows.shape[1]]}
        return self.add("accessors", {"bufferView": view, "count": len(values), **described, **more})

    def primitive(self, attributes: dict[str, Any], indices: np.ndarray | None = None, **more: Any) -> dict[str, Any]:
        """Add a primitive of arrays, or of accessors that are there, to the mesh."""
        stored = {name: v if isinstance(v, int) else self.accessor(v) for name, v in attributes.items()}
        entry: dict[str, Any] = {"attributes": stored, **more}
        if indices is not None:
            entry["indices"] = self.accessor(indices)
        self.header["meshes"][0]["primitives"].append(entry)
        return entry

    def textured(self, image: dict[str, Any], sampler: dict[str, Any] | None = None, **info: Any) -> int:
        """Add a material with an image as its base texture; its index."""
        texture: dict[str, Any] = {"source": self.add("images", image)}
        if sampler is not None:
            texture["sampler"] = self.add("samplers", sampler)
        described = {"index": self.add("textures", texture), **info}
        return self.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": described}})

    def image(self, pixels: np.ndarray) -> dict[str, Any]:
        """An image of some pixels, as a PNG within the header."""
        content = io.BytesIO()
        Image.fromarray(pixels).save(content, "PNG")
        return {"uri": "data:image/png;base64," + base64.b64encode(content.getvalue()).decode()}

    def require(self, *extensions: str) -> None:
        """Say that the file needs extensions."""
        for key in ("extensionsUsed", "extensionsRequired"):
            self.header.setdefault(key, []).extend(extensions)

    def save(self, name: str = "scene.gltf") -> Path:
        """Write a .gltf with its buffer inside, or a .glb."""
        path = self.folder / name
        own = {"byteLength": len(self.content)}
        if path.suffix == ".glb":
            header = self.header if "buffers" in self.header else {**self.header, "buffers": [own]}
            path.write_bytes(glb((b"JSON", json.dumps(header).encode()), (b"BIN\0", bytes(self.content))))
        else:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.content).decode()
            path.write_text(json.dumps({"buffers": [{"uri": uri, **own}], **self.header}))
        return path


def glb(*chunks: tuple[bytes, bytes]) -> bytes:
    """The content of a .glb file with chunks of some types."""
    padded = [(kind, data + (b" " if kind == b"JSON" else b"\0") * (-len(data) % 4)) for kind, data in chunks]
    body = b"".join(struct.pack("<I", len(data)) + kind + data for kind, data in padded)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
