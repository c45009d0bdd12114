import base64
import copy
import json
import random
import struct
import sys
from urllib.parse import quote

import numpy as np
import pytest

from deux.errors import DeuxError
from deux.mesh_files.gltf_document import GltfDocument
from deux.mesh_files.gltf_file import read_gltf, referenced_by_gltf

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]], np.float32)


def corners(path):
    return np.concatenate([part.vertices[part.faces] for part in read_gltf(path)])


def chunk(kind, data):
    return struct.pack("<I", len(data)) + kind + data


def glb_of(*chunks, length=None):
    body = b"".join(chunks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body) if length is None else length) + body


@pytest.fixture
def triangle(gltf):
    """A writer with one triangle of nine floats, 36 bytes."""
    gltf.primitive({"POSITION": TRIANGLE})
    return gltf


@pytest.mark.parametrize(
    ("name", "uri"),
    [
        ("room.bin", "room.bin"),
        ("my room.bin", "my%20room.bin"),
        ("my room.bin", "my room.bin"),
        ("Büro.bin", quote("Büro.bin")),
        ("部屋.bin", "部屋.bin"),
        ("100%25.bin", "100%25.bin"),  # literal, though it looks encoded
        ("parts/room.bin", "parts\\room.bin"),
        ("parts/room.bin", "./parts/room.bin"),
    ],
)
def test_buffers_lie_in_files_of_any_name(triangle, name, uri):
    path = triangle.folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(triangle.content)
    triangle.header["buffers"] = [{"uri": uri, "byteLength": 36}]
    scene = triangle.save()
    np.testing.assert_array_equal(corners(scene), [TRIANGLE])
    (referenced,) = referenced_by_gltf(scene)
    assert (scene.parent / referenced).samefile(path)


@pytest.mark.parametrize(
    "encode",
    [
        lambda data: "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
        lambda data: "data:application/gltf-buffer;base64," + base64.b64encode(data).decode().rstrip("="),
        lambda data: "data:;base64," + quote(base64.b64encode(data)),
        lambda data: "data:application/octet-stream," + quote(data),
    ],
)
def test_data_uris(triangle, encode):
    triangle.header["buffers"] = [{"uri": encode(bytes(triangle.content)), "byteLength": 36}]
    path = triangle.save()
    np.testing.assert_array_equal(corners(path), [TRIANGLE])
    assert referenced_by_gltf(path) == []


def test_several_buffers(gltf):
    gltf.primitive({"POSITION": TRIANGLE})
    gltf.primitive({"POSITION": TRIANGLE + 5})
    (gltf.folder / "second.bin").write_bytes(bytes(8) + gltf.content[36:])
    gltf.header["bufferViews"][1] |= {"buffer": 1, "byteOffset": 8}
    gltf.header["buffers"] = [{"byteLength": 36}, {"uri": "second.bin", "byteLength": 44}]
    path = gltf.save("scene.glb")
    np.testing.assert_array_equal(corners(path), [TRIANGLE, TRIANGLE + 5])
    assert referenced_by_gltf(path) == ["second.bin"]


def test_glb_chunks(triangle):
    header = json.dumps({**triangle.header, "buffers": [{"byteLength": 36}]}).encode()
    aligned = header + b" " * (-len(header) % 4)
    odd = header + b" " * ((1 - len(header)) % 4)
    assert len(odd) % 4 == 1
    json_chunk, binary = chunk(b"JSON", aligned), chunk(b"BIN\0", bytes(triangle.content))
    path = triangle.folder / "scene.glb"
    for content in (
        glb_of(json_chunk, binary),
        glb_of(json_chunk, chunk(b"BIN\0", bytes(triangle.content) + b"\0\0\0")),  # padding counts as the chunk's
        glb_of(chunk(b"JSON", odd), binary),
        glb_of(json_chunk, binary, chunk(b"XTRA", b"12345678")),
        glb_of(json_chunk, binary, chunk(b"BIN\0", bytes(36))),  # a second one is nobody's
        glb_of(json_chunk, binary) + b"rubbish",
    ):
        path.write_bytes(content)
        np.testing.assert_array_equal(corners(path), [TRIANGLE])


def test_the_content_determines_which_kind_a_file_is(triangle):
    binary = triangle.save("scene.glb")
    np.testing.assert_array_equal(corners(binary.rename(triangle.folder / "other.gltf")), [TRIANGLE])
    text = triangle.save("text.gltf").rename(triangle.folder / "text.glb")
    np.testing.assert_array_equal(corners(text), [TRIANGLE])


def test_a_file_cut_anywhere_is_damaged(triangle):
    path = triangle.save("scene.glb")
    whole = path.read_bytes()
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        with pytest.raises(DeuxError) as raised:
            read_gltf(path)
        assert str(raised.value).startswith(str(path))


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DeuxError, match=r"gone\.glb cannot be read: No such file or directory"):
        read_gltf(tmp_path / "gone.glb")


def set_in(header, value, *keys):
    for key in keys[:-1]:
        header = header[key]
    header[keys[-1]] = value


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("asset", "version"), "1.0", "version 1.0 of glTF: convert it to version 2"),
        (("asset",), {"version": "2.0", "minVersion": "3.0"}, "version 3.0 of glTF"),
        (("extensionsRequired",), ["KHR_lights_punctual", "ACME_doors"], "requires the glTF extension ACME_doors"),
        (("extensionsRequired",), "KHR_lights_punctual", "extensionsRequired is .*, but must be a list"),
        (("buffers",), [{"byteLength": 36}], r"meshes\[0\].primitives\[0\] is damaged: buffers\[0\] has neither"),
        (("buffers",), [{"uri": "gone.bin", "byteLength": 36}], "needs gone.bin, which is not in"),
        (("buffers",), [{"uri": "data:,abc", "byteLength": 36}], r"buffers\[0\] is truncated to 3 of 36 bytes"),
        (("buffers",), [{"uri": "data:abc", "byteLength": 36}], "no comma"),
        (("buffers",), [{"uri": "https://a.org/room.bin", "byteLength": 36}], "the address https://a.org/room.bin"),
        (("bufferViews", 0, "byteOffset"), 4, r"bufferViews\[0\] ends at byte 40 of buffers\[0\], which has 36"),
        (("bufferViews", 0, "byteOffset"), -4, "byteOffset is -4, but must be a whole number"),
        (("bufferViews", 0, "byteLength"), "36", "byteLength is '36', but must be a whole number"),
        (("bufferViews",), [{"buffer": 0}], r"bufferViews\[0\] has no byteLength"),
        (("bufferViews", 0, "buffer"), 3, r"it refers to buffers\[3\], but there are 1 buffers"),
    ],
)
def test_mistakes_are_named(triangle, keys, value, message):
    triangle.header["extensionsRequired"] = []
    triangle.header["buffers"] = [
        {"uri": "data:;base64," + base64.b64encode(triangle.content).decode(), "byteLength": 36}
    ]
    set_in(triangle.header, value, *keys)
    with pytest.raises(DeuxError, match=message) as raised:
        read_gltf(triangle.save())
    assert "scene.gltf" in str(raised.value)


def leaves(node, keys=()):
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    yield from [keys] if keys else []
    for key, child in children:
        yield from leaves(child, (*keys, key))


def test_no_broken_header_escapes_as_another_error(gltf):
    """Each value of a header is replaced by values of all kinds: the file is read, or one sentence names it."""
    gltf.primitive({"POSITION": TRIANGLE, "TEXCOORD_0": TRIANGLE[:, :2]}, np.arange(3, dtype=np.uint8), material=0)
    gltf.textured(gltf.image(np.full((2, 2, 3), 9, np.uint8)), {"wrapS": 33071}, texCoord=0)
    gltf.header["nodes"][0] |= {"rotation": [0, 0, 0, 1], "children": []}
    gltf.header["buffers"] = [{"uri": "data:;base64," + base64.b64encode(gltf.content).decode(), "byteLength": 84}]
    random.seed(13)
    outcomes = []
    for keys in list(leaves(gltf.header)):
        for value in random.sample([None, -1, 2, 1e9, 0.5, "x", [], {}, [[1]], {"a": 1}, True, 10**20], 5):
            broken = copy.deepcopy(gltf.header)
            set_in(broken, value, *keys)
            path = gltf.folder / "scene.gltf"
            path.write_text(json.dumps(broken))
            for read in (read_gltf, referenced_by_gltf):
                try:
                    read(path)
                    outcomes.append("read")
                except DeuxError as error:
                    outcomes.append(str(error).replace(str(path), "refused", 1).split()[0])
    assert set(outcomes) == {"read", "refused"}


def test_images_of_other_maps_are_no_parts_of_the_scene(triangle):
    material = triangle.textured({"uri": "wall%20paper.png"})
    normal_map = triangle.add("textures", {"source": triangle.add("images", {"uri": "bumps.png"})})
    triangle.header["materials"][material]["normalTexture"] = {"index": normal_map}
    assert referenced_by_gltf(triangle.save()) == ["wall paper.png"]


@pytest.fixture
def meshopt():
    return pytest.importorskip("meshopt", reason="meshopt is not installed: pip install -e '.[compressed]'")


def compressed_view(gltf, meshopt, values, mode, extension="EXT_meshopt_compression", **more):
    """A buffer view whose content is compressed; the plain one would lie in a second buffer, which is left out."""
    rows = np.ascontiguousarray(values)
    stride = rows.nbytes // len(rows)
    version = 1 if extension.startswith("KHR") else 0
    content = meshopt.encode_gltf_buffer(rows, mode, version) if mode == "ATTRIBUTES" else None
    content = content or meshopt.encode_gltf_buffer(rows, mode)
    inner = {"buffer": 0, "byteOffset": len(gltf.content), "byteLength": len(content), "byteStride": stride}
    gltf.content += content
    inner |= {"count": len(rows), "mode": mode, **more}
    plain = {"buffer": 1, "byteLength": rows.nbytes, "extensions": {extension: inner}}
    return gltf.add("bufferViews", plain | ({"byteStride": stride} if mode == "ATTRIBUTES" else {}))


def compressed_grid(gltf, meshopt, extension, mode="TRIANGLES", index_type=np.uint16):
    """A file of 18 triangles, all of it compressed; its corners."""
    x, y = np.meshgrid(np.arange(4), np.arange(4))
    vertices = np.stack([x, y, x * y], axis=-1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(3)[:, None] * 4 + np.arange(3)).reshape(-1, 1)
    faces = np.concatenate([first + np.array(corner) for corner in ((0, 1, 4), (1, 5, 4))]).astype(index_type)
    views = [
        compressed_view(gltf, meshopt, vertices, "ATTRIBUTES", extension),
        compressed_view(gltf, meshopt, faces.reshape(-1), mode, extension),
    ]
    position = gltf.add("accessors", {"bufferView": views[0], "componentType": 5126, "count": 16, "type": "VEC3"})
    kind = 5123 if index_type is np.uint16 else 5125
    indices = gltf.add("accessors", {"bufferView": views[1], "componentType": kind, "count": 54, "type": "SCALAR"})
    gltf.primitive({"POSITION": position})["indices"] = indices
    gltf.header["buffers"] = [{"byteLength": len(gltf.content)}, {"byteLength": 300, "extensions": {extension: {}}}]
    gltf.require(extension)
    return vertices[faces.astype(int)]


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize("mode", ["TRIANGLES", "INDICES"])
@pytest.mark.parametrize("index_type", [np.uint16, np.uint32])
def test_meshopt_compression(gltf, meshopt, extension, mode, index_type):
    expected = compressed_grid(gltf, meshopt, extension, mode, index_type)
    read = corners(gltf.save("scene.glb"))
    # The encoder may turn the corners of a triangle in a cycle.
    turned = np.stack([np.roll(expected, shift, axis=1) for shift in range(3)])
    assert (turned == read).all(axis=(2, 3)).any(axis=0).all()


def test_meshopt_filters(gltf, meshopt):
    values = np.random.default_rng(3).uniform(-5, 5, (8, 3)).astype(np.float32)
    encoded = meshopt.encode_filter_exp(values, 20)
    view = compressed_view(gltf, meshopt, encoded, "ATTRIBUTES", filter="EXPONENTIAL")
    gltf.header["buffers"] = [{"byteLength": len(gltf.content)}, {"byteLength": 96}]
    decoded = GltfDocument(gltf.save("scene.glb")).view(view).view(np.float32).reshape(8, 3)
    np.testing.assert_allclose(decoded, values, atol=5 * 2**-18)


def test_meshopt_without_its_package(gltf, meshopt, monkeypatch):
    compressed_grid(gltf, meshopt, "EXT_meshopt_compression")
    path = gltf.save("scene.glb")
    monkeypatch.setitem(sys.modules, "meshopt", None)
    with pytest.raises(DeuxError, match=r'meshopt-compressed geometry.*pip install "deux\[compressed\]"'):
        read_gltf(path)


def test_damaged_meshopt_is_named(gltf, meshopt):
    compressed_grid(gltf, meshopt, "EXT_meshopt_compression")
    gltf.content[:4] = bytes(4)
    with pytest.raises(DeuxError, match=r"meshes\[0\].primitives\[0\] is damaged: meshopt cannot decode bufferViews"):
        read_gltf(gltf.save("scene.glb"))


def test_optional_compression_is_read_from_its_plain_copy(triangle, monkeypatch):
    extension = {"buffer": 0, "byteLength": 1, "byteStride": 12, "count": 3, "mode": "ATTRIBUTES"}
    triangle.header["bufferViews"][0]["extensions"] = {"EXT_meshopt_compression": extension}
    triangle.header["extensionsUsed"] = ["EXT_meshopt_compression"]
    monkeypatch.setitem(sys.modules, "meshopt", None)
    np.testing.assert_array_equal(corners(triangle.save()), [TRIANGLE])
