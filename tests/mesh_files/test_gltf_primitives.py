import struct
import sys

import numpy as np
import pytest

from deux.errors import DeuxError
from deux.mesh_files.gltf_document import GltfDocument
from deux.mesh_files.gltf_file import read_gltf
from deux.mesh_files.gltf_primitives import read_accessor

SQUARE = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], np.float32)
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
PIXEL = np.full((1, 1, 3), 200, np.uint8)

# componentType: its letter in `struct`, and what normalisation divides by (glTF 2.0, section 3.6.2.2).
COMPONENTS = {5120: ("b", 127), 5121: ("B", 255), 5122: ("h", 32767), 5123: ("H", 65535), 5125: ("I", None)}
COMPONENTS |= {5126: ("f", None)}
# type: columns and rows.
TYPES = {"SCALAR": (1, 1), "VEC2": (1, 2), "VEC3": (1, 3), "VEC4": (1, 4), "MAT2": (2, 2), "MAT3": (3, 3)}
TYPES |= {"MAT4": (4, 4)}


def corners(path):
    return np.concatenate([part.vertices[part.faces] for part in read_gltf(path)])


def packed(values, letter, columns, rows):
    """One element: its columns each begin at a multiple of four bytes if there are several."""
    content = b""
    for column in range(columns):
        content += struct.pack(f"<{rows}{letter}", *values[column * rows : (column + 1) * rows])
        content += bytes(-len(content) % 4) if column < columns - 1 else b""
    return content


@pytest.mark.parametrize("component", COMPONENTS)
@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("stride", [None, 68])
def test_accessors_of_every_type(gltf, component, kind, stride):
    letter, divisor = COMPONENTS[component]
    columns, rows = TYPES[kind]
    rng = np.random.default_rng(component)
    bits = 8 * struct.calcsize(letter)
    low, high = (0, 2**bits) if letter.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1))
    values = rng.integers(low, high, (5, columns * rows)) if letter != "f" else rng.normal(size=(5, columns * rows))
    values = values.astype(letter)
    elements = [packed(row, letter, columns, rows) for row in values]
    size = -(-len(elements[0]) // 4) * 4 if columns > 1 else len(elements[0])
    content = b"\xee" * 8 + b"".join(e + b"\xee" * ((stride or size) - len(e)) for e in elements[:-1]) + elements[-1]
    view = gltf.view(content, **({"byteStride": stride} if stride else {}))
    entry = {"bufferView": view, "byteOffset": 8, "componentType": component, "count": 5, "type": kind}
    plain = gltf.add("accessors", entry)
    normalised = gltf.add("accessors", {**entry, "normalized": True})
    document = GltfDocument(gltf.save())
    read = read_accessor(document, plain)
    np.testing.assert_array_equal(read, values)
    assert read.dtype.kind == values.dtype.kind
    if divisor:
        expected = [[max(int(value) / divisor, -1) for value in row] for row in values]
        np.testing.assert_allclose(read_accessor(document, normalised), expected, rtol=1e-15)


@pytest.mark.parametrize("has_view", [True, False])
def test_sparse_accessors(gltf, has_view):
    indices = np.array([1, 4, 5], np.uint8)
    replaced = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], np.float32)
    expected = np.arange(18, dtype=np.float32).reshape(6, 3) if has_view else np.zeros((6, 3), np.float32)
    index = gltf.accessor(expected)
    if not has_view:
        del gltf.header["accessors"][index]["bufferView"]
    gltf.header["accessors"][index]["sparse"] = {
        "count": 3,
        "indices": {"bufferView": gltf.view(bytes(1) + indices.tobytes()), "byteOffset": 1, "componentType": 5121},
        "values": {"bufferView": gltf.view(replaced.tobytes())},
    }
    expected[indices] = replaced
    document = GltfDocument(gltf.save())
    np.testing.assert_array_equal(read_accessor(document, index), expected)


def test_a_sparse_index_beyond_its_values_is_named(gltf):
    index = gltf.accessor(SQUARE)
    gltf.header["accessors"][index]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": gltf.view(b"\4"), "componentType": 5121},
        "values": {"bufferView": gltf.view(bytes(12))},
    }
    gltf.primitive({"POSITION": index}, FACES)
    with pytest.raises(DeuxError, match=r"accessors\[0\].sparse has the index 4, but there are 4 values"):
        read_gltf(gltf.save())


def test_interleaved_attributes(gltf):
    uv = np.array([[0, 0], [1, 0], [1, 0.5], [0, 0.5]], np.float32)
    colors = np.array([[10, 20, 30, 0], [40, 50, 60, 0], [70, 80, 90, 0], [1, 2, 3, 0]], np.uint8)
    content = b"".join(p.tobytes() + t.tobytes() + c.tobytes() for p, t, c in zip(SQUARE, uv, colors, strict=True))
    view = gltf.view(content, byteStride=24)
    described = [("POSITION", 0, 5126, "VEC3"), ("TEXCOORD_0", 12, 5126, "VEC2"), ("COLOR_0", 20, 5121, "VEC3")]
    attributes = {
        name: gltf.add(
            "accessors",
            {"bufferView": view, "byteOffset": offset, "componentType": component, "count": 4, "type": kind},
        )
        for name, offset, component, kind in described
    }
    gltf.header["accessors"][2]["normalized"] = True
    gltf.primitive(attributes, FACES, material=gltf.textured(gltf.image(PIXEL)))
    (part,) = read_gltf(gltf.save())
    np.testing.assert_array_equal(part.vertices[part.faces], SQUARE[FACES].reshape(2, 3, 3))
    np.testing.assert_array_equal(part.uv, (uv * [1, -1] + [0, 1])[FACES].reshape(2, 3, 2))
    np.testing.assert_array_equal(part.vertex_colors, colors[:, :3])


@pytest.mark.parametrize("index_type", [np.uint8, np.uint16, np.uint32])
def test_indices_of_every_type(gltf, index_type):
    gltf.primitive({"POSITION": SQUARE}, FACES.astype(index_type))
    np.testing.assert_array_equal(corners(gltf.save()), SQUARE[FACES].reshape(2, 3, 3))


def test_primitives_without_indices(gltf):
    gltf.primitive({"POSITION": SQUARE[FACES]})
    np.testing.assert_array_equal(corners(gltf.save()), SQUARE[FACES].reshape(2, 3, 3))


def strip(count):
    """Triangles of a strip, by the formula of section 3.7.2.1."""
    return [(i, i + 1 + i % 2, i + 2 - i % 2) for i in range(count - 2)]


def fan(count):
    return [(i + 1, i + 2, 0) for i in range(count - 2)]


@pytest.mark.parametrize(("mode", "triangles"), [(5, strip), (6, fan)])
@pytest.mark.parametrize("indexed", [True, False])
def test_strips_and_fans(gltf, mode, triangles, indexed):
    turns = np.linspace(0, 2, 8)
    around = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    zigzag = np.stack([np.arange(8) // 2, np.arange(8) % 2, 0 * turns], axis=1)
    points = (zigzag[:, [1, 0, 2]] if mode == 5 else around).astype(np.float32)
    order = np.arange(8)[::-1].astype(np.uint8)
    gltf.primitive({"POSITION": points[order] if indexed else points}, order if indexed else None, mode=mode)
    read = corners(gltf.save())
    np.testing.assert_array_equal(read, points[triangles(8)])
    sides = np.cross(read[:, 1] - read[:, 0], read[:, 2] - read[:, 0])[:, 2]
    assert (sides > 0).all(), "all of them face one way"


def test_strips_are_joined_by_triangles_without_area(gltf):
    joined = np.array([0, 1, 3, 3, 1, 1, 2, 3], np.uint8)
    gltf.primitive({"POSITION": SQUARE}, joined, mode=5)
    assert len(corners(gltf.save())) == 2


@pytest.mark.parametrize("mode", [5, 6])
def test_primitives_of_too_few_corners_draw_nothing(gltf, mode):
    gltf.primitive({"POSITION": SQUARE}, np.zeros(2, np.uint8), mode=mode)
    assert read_gltf(gltf.save()) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"type": "VEC5"}, "type is 'VEC5', but must be SCALAR"),
        ({"componentType": 5124}, "componentType is 5124, but must be a type of component"),
        ({"count": 0}, "count is 0, but must be a whole number from 1"),
        ({"count": -1}, "count is -1, but must be a whole number from 1"),
    ],
)
def test_accessors_of_no_kind_are_refused(gltf, change, message):
    gltf.primitive({"POSITION": SQUARE}, np.array(FACES, np.uint8))
    gltf.header["accessors"][0] |= change
    with pytest.raises(DeuxError, match=rf"its header is damaged: accessors\[0\].{message}"):
        read_gltf(gltf.save())


def test_vertices_that_no_face_uses_are_left_out(gltf):
    values = np.full((7, 3), np.nan, np.float32)
    values[[1, 3, 4, 6]] = SQUARE
    colors = np.arange(28, dtype=np.uint8).reshape(7, 4)
    gltf.primitive({"POSITION": values, "COLOR_0": colors}, np.array([1, 3, 4, 6])[FACES].astype(np.uint8))
    (part,) = read_gltf(gltf.save())
    np.testing.assert_array_equal(part.vertices, SQUARE)
    np.testing.assert_array_equal(part.vertex_colors, colors[[1, 3, 4, 6], :3])
    np.testing.assert_array_equal(part.faces.reshape(-1), FACES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"indices": [0, 1, 9]}, "it has the index 9, but 4 vertices"),
        ({"indices": [0, 1, 2, 3]}, "it has 4 corners of triangles, which is not a multiple of 3"),
        ({"mode": 7}, "there is no primitive mode 7"),
        ({"accessor": {"count": 5}}, r"accessors\[0\] ends at byte 60 of bufferViews\[0\], which has 48"),
        ({"accessor": {"byteOffset": 4}}, r"accessors\[0\] ends at byte 52 of bufferViews\[0\]"),
        ({"accessor": {"type": "VEC2"}}, "its POSITION has 2 components"),
        ({"color": np.zeros((3, 4), np.uint8)}, "its COLOR_0 has 3 values for 4 vertices"),
        ({"signed": True}, r"accessors\[1\] are not indices"),
    ],
)
def test_damaged_primitives_are_named(gltf, change, message):
    indices = np.array(change.get("indices", FACES), np.int8 if "signed" in change else np.uint8)
    entry = gltf.primitive({"POSITION": SQUARE}, indices)
    gltf.header["meshes"][0]["name"] = "Sofa"
    gltf.header["accessors"][0] |= change.get("accessor", {})
    entry |= {"mode": change["mode"]} if "mode" in change else {}
    if "color" in change:
        entry["attributes"]["COLOR_0"] = gltf.accessor(change["color"])
    with pytest.raises(DeuxError, match=r"scene.gltf .*meshes\[0\].primitives\[0\] \(Sofa\) is damaged: " + message):
        read_gltf(gltf.save())


def test_quantised_positions(gltf):
    """KHR_mesh_quantization: integers that a node's transform brings to metres."""
    normalised = gltf.accessor((SQUARE / 4 * 65535).astype(np.uint16), normalized=True)
    plain = gltf.accessor((SQUARE * 25).astype(np.int8))
    for index in (normalised, plain):
        gltf.primitive({"POSITION": index}, FACES)
    second = gltf.header["meshes"][0]["primitives"].pop()
    gltf.header["meshes"].append({"primitives": [second]})
    gltf.header["nodes"] = [{"mesh": 0, "scale": [4, 4, 4]}, {"mesh": 1, "scale": [0.04, 0.04, 0.04]}]
    gltf.header["scenes"] = [{"nodes": [0, 1]}]
    gltf.require("KHR_mesh_quantization")
    expected = np.tile(SQUARE[FACES].reshape(2, 3, 3), (2, 1, 1))
    np.testing.assert_allclose(corners(gltf.save()), expected, atol=1e-12)


@pytest.mark.parametrize("of_node", [True, False])
def test_morph_targets_have_their_default_weights(gltf, of_node):
    targets = np.random.default_rng(2).normal(size=(2, 4, 3)).astype(np.float32)
    stored = [{"POSITION": gltf.accessor(target), "NORMAL": 0} for target in targets]
    gltf.primitive({"POSITION": SQUARE}, FACES, targets=stored)
    gltf.header["meshes"][0]["weights"] = [5, 5] if of_node else [0.25, -2]
    if of_node:
        gltf.header["nodes"][0]["weights"] = [0.25, -2]
    expected = SQUARE.astype(float) + 0.25 * targets[0] - 2.0 * targets[1]
    np.testing.assert_allclose(corners(gltf.save()), expected[FACES].reshape(2, 3, 3), atol=1e-12)


@pytest.fixture
def draco():
    return pytest.importorskip("DracoPy", reason="DracoPy is not installed: pip install -e '.[compressed]'")


def compressed_square(gltf, draco):
    colors = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 8, 7, 255]], np.uint8)
    uv = (SQUARE[:, :2] / 4).astype(np.float64)
    faces = FACES.reshape(-1, 3).astype(np.uint32)
    content = draco.encode(SQUARE, faces, colors=colors, tex_coord=uv, quantization_bits=20, preserve_order=True)
    kinds = {attribute["attribute_type"]: attribute["unique_id"] for attribute in draco.decode(content).attributes}
    identities = {"POSITION": kinds[0], "COLOR_0": kinds[2], "TEXCOORD_0": kinds[3]}
    values = {"POSITION": SQUARE, "COLOR_0": colors, "TEXCOORD_0": uv.astype(np.float32)}
    entry = gltf.primitive(values, FACES)
    gltf.header["accessors"][1]["normalized"] = True
    compression = {"bufferView": gltf.view(content), "attributes": identities}
    entry["extensions"] = {"KHR_draco_mesh_compression": compression}
    return entry, colors, uv


def without_plain_data(gltf):
    for accessor in gltf.header["accessors"]:
        accessor.pop("bufferView")


@pytest.mark.parametrize("required", [True, False])
def test_draco_compression(gltf, draco, required):
    entry, colors, uv = compressed_square(gltf, draco)
    without_plain_data(gltf)
    entry["material"] = gltf.textured(gltf.image(PIXEL))
    if required:
        gltf.require("KHR_draco_mesh_compression")
    (part,) = read_gltf(gltf.save("scene.glb"))
    np.testing.assert_allclose(part.vertices[part.faces].reshape(-1, 3), SQUARE[FACES], atol=1e-5)
    np.testing.assert_array_equal(part.vertex_colors[part.faces].reshape(-1, 3), colors[FACES, :3])
    np.testing.assert_allclose(part.uv.reshape(-1, 2), (uv * [1, -1] + [0, 1])[FACES], atol=1e-5)


def test_draco_without_its_package(gltf, draco, monkeypatch):
    compressed_square(gltf, draco)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    np.testing.assert_array_equal(corners(gltf.save("plain.glb")), SQUARE[FACES].reshape(2, 3, 3))
    without_plain_data(gltf)
    gltf.require("KHR_draco_mesh_compression")
    with pytest.raises(DeuxError, match=r'Draco-compressed geometry.*pip install "deux\[compressed\]"'):
        read_gltf(gltf.save("scene.glb"))


def test_damaged_draco_is_named(gltf, draco):
    entry, _, _ = compressed_square(gltf, draco)
    without_plain_data(gltf)
    view = entry["extensions"]["KHR_draco_mesh_compression"]["bufferView"]
    gltf.header["bufferViews"][view]["byteLength"] = 20
    with pytest.raises(DeuxError, match=r"meshes\[0\].primitives\[0\] is damaged: Draco cannot decode bufferViews"):
        read_gltf(gltf.save("scene.glb"))
