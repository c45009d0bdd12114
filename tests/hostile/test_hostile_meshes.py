"""Mesh files that are wrong on purpose: glTF, OBJ and PLY."""

import io
import json
import struct

import numpy as np
import pytest
from gltf_writer import GltfWriter, glb
from hostile import NO_JSON, Case, changed_values, damaged_bytes, texts
from PIL import Image
from png_files import png

from deux.mesh_files.mesh_reader import read_mesh
from deux_plugins.scenes.files import check_scene_file, file_identity

CORNERS = np.array([[0, 0, 0], [0, 0, 4], [4, 0, 4], [4, 0, 0]], np.float32)
INDICES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
PIXELS = np.random.default_rng(0).integers(0, 255, (4, 4, 3), np.uint8)


def document(folder) -> GltfWriter:
    """A glTF file with one of each object that is read."""
    gltf = GltfWriter(folder)
    uv = CORNERS[:, [0, 2]] / 4
    picture = gltf.image(PIXELS)
    material = gltf.textured(picture, {"wrapS": 33071, "wrapT": 33648}, texCoord=0)
    info = gltf.header["materials"][material]["pbrMetallicRoughness"]
    info["baseColorFactor"] = [1, 0.5, 0.5, 1]
    transform = {"offset": [0, 0.1], "rotation": 0.1, "scale": [1, 2], "texCoord": 0}
    info["baseColorTexture"]["extensions"] = {"KHR_texture_transform": transform}
    glossy = {"diffuseFactor": [1, 1, 1, 1], "diffuseTexture": {"index": 0}}
    gltf.add("materials", {"name": "b", "extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}})
    moved = gltf.accessor(np.full((4, 3), 0.1, np.float32))
    sparse = {
        "count": 1,
        "indices": {"bufferView": gltf.view(struct.pack("<H", 1)), "componentType": 5123, "byteOffset": 0},
        "values": {"bufferView": gltf.view(np.ones(3, np.float32).tobytes()), "byteOffset": 0},
    }
    raised = gltf.add("accessors", {"count": 4, "componentType": 5126, "type": "VEC3", "sparse": sparse})
    values = {"POSITION": CORNERS, "TEXCOORD_0": uv, "COLOR_0": np.full((4, 4), 200, np.uint8)}
    gltf.primitive(values, INDICES, material=material, mode=4, targets=[{"POSITION": moved}, {"POSITION": raised}])
    gltf.header["meshes"][0] |= {"name": "m", "weights": [0.5, 0.25]}
    joints = {"JOINTS_0": np.zeros((4, 4), np.uint8), "WEIGHTS_0": np.eye(4, dtype=np.float32)[[0] * 4]}
    primitive = gltf.primitive({"POSITION": CORNERS + 1, "TEXCOORD_0": uv, **joints}, INDICES, material=1)
    gltf.header["meshes"].append({"primitives": [primitive]})
    gltf.header["meshes"][0]["primitives"].pop()
    inverse = gltf.view(np.eye(4, dtype=np.float32).tobytes())
    bind = gltf.add("accessors", {"bufferView": inverse, "count": 1, "componentType": 5126, "type": "MAT4"})
    gltf.add("skins", {"joints": [2], "inverseBindMatrices": bind})
    places = {"TRANSLATION": gltf.accessor(np.array([[0, 0, 0], [5, 0, 0]], np.float32))}
    places["ROTATION"] = gltf.accessor(np.array([[0, 0, 0, 1]] * 2, np.float32))
    gltf.header["nodes"] = [
        {"children": [1, 2, 3], "rotation": [0, 0, 0, 1], "translation": [0, 0, 1], "scale": [1, 1, 1]},
        {"mesh": 0, "weights": [0.5, 0.5], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": places}}},
        {"mesh": 1, "skin": 0, "extensions": {"KHR_node_visibility": {"visible": True}}},
        {"mesh": 0, "matrix": np.eye(4).reshape(-1).tolist()},
    ]
    gltf.require("EXT_mesh_gpu_instancing")
    return gltf


def read(path):
    """What loading a scene does first."""
    path = check_scene_file(path)
    file_identity(path)
    return read_mesh(path)


def test_the_untouched_file_is_read(tmp_path):
    assert len(read(document(tmp_path).save("scene.gltf")).faces) == 8


def gltf_values(campaign):
    path = document(campaign.folder).save("scene.gltf")
    whole = json.loads(path.read_text())
    campaign.run(changed_values(whole), path, lambda: read(path))
    campaign.end()


def test_gltf_with_other_values(campaign):
    gltf_values(campaign)


@pytest.mark.slow
def test_gltf_with_all_other_values(campaign):
    gltf_values(campaign)


def test_gltf_with_a_file_beside_it(campaign):
    gltf = document(campaign.folder)
    (campaign.folder / "a.png").write_bytes(png(4, 4))
    gltf.header["images"][0] = {"uri": "a.png", "name": "a", "mimeType": "image/png"}
    path = gltf.save("scene.gltf")
    whole = json.loads(path.read_text())
    images = [{**whole, "images": [json.loads(case.content)]} for case in changed_values(whole["images"][0])]
    campaign.run((Case(str(k), json.dumps(one).encode()) for k, one in enumerate(images)), path, lambda: read(path))
    campaign.end()


def test_gltf_that_is_no_json(campaign):
    path = campaign.folder / "scene.gltf"
    campaign.run(NO_JSON, path, lambda: read(path))
    path = document(campaign.folder).save("scene.glb")
    content = path.read_bytes()
    chunks = [Case(f"a chunk of {case.name}", glb((b"JSON", case.content), (b"BIN\0", b"\0" * 64))) for case in NO_JSON]
    campaign.run([*damaged_bytes(content, 90), *damaged_bytes(content[:40], 60), *chunks], path, lambda: read(path))
    campaign.end()


def test_small_gltf_that_asks_for_much(campaign):
    path = campaign.folder / "scene.gltf"

    def case(name, change):
        gltf = document(campaign.folder)
        change(gltf.header, gltf)
        path = gltf.save("scene.gltf")
        return Case(name, path.read_bytes())

    def many_instances(header, gltf):
        header["nodes"][1]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
            "TRANSLATION": gltf.add("accessors", {"count": 50_000_000, "componentType": 5126, "type": "VEC3"})
        }

    def many_vertices(header, gltf):
        zeros = gltf.add("accessors", {"count": 400_000_000, "componentType": 5126, "type": "VEC3"})
        header["meshes"][0]["primitives"][0] = {"attributes": {"POSITION": zeros}}

    def many_nodes(header, gltf):
        header["nodes"] = [{"children": list(range(1, 20_001))}, *({"mesh": 0} for _ in range(20_000))]
        for node in header["nodes"][1:]:
            node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": instances}}}

    def texture(header, gltf):
        (campaign.folder / "bomb.png").write_bytes(png(20_000, 20_000, mode=0))
        header["images"][0] = {"uri": "bomb.png"}

    def inner_texture(header, gltf):
        header["images"][0] = {"bufferView": gltf.view(png(20_000, 20_000, mode=0)), "mimeType": "image/png"}

    def compressed(header, gltf):
        view = gltf.view(bytes(16))
        described = {"buffer": 0, "byteOffset": 0, "byteLength": 16, "byteStride": 16, "count": 10**9}
        header["bufferViews"][view]["extensions"] = {
            "EXT_meshopt_compression": {**described, "mode": "ATTRIBUTES", "filter": "NONE"}
        }
        gltf.require("EXT_meshopt_compression")
        header["accessors"][0]["bufferView"] = view

    gltf = document(campaign.folder)
    instances = gltf.add("accessors", {"count": 5000, "componentType": 5126, "type": "VEC3"})

    def nodes_of_instances(header, gltf):
        gltf.add("accessors", {"count": 5000, "componentType": 5126, "type": "VEC3"})
        many_nodes(header, gltf)

    changes = (many_instances, many_vertices, nodes_of_instances, texture, inner_texture, compressed)
    campaign.run([case(change.__name__, change) for change in changes], path, lambda: read(path))
    campaign.end()


VERTICES = "v 0 0 0\nv 0 0 4\nv 4 0 4\nv 4 0 0\nvt 0 0\nvt 0 1\nvt 1 1\nvt 1 0\n"
OBJ = f"mtllib m.mtl\n{VERTICES}usemtl m\nf 1/1 2/2 3/3 4/4\nf 1 2 3\n"
TOKENS = (
    "nan",
    "inf",
    "-1",
    "0",
    "99",
    "9" * 400,
    "1e400",
    "x",
    "",
    "1/",
    "/1",
    "-99/-99",
    "\0",
    "../../a.png",
    "a" * 5000,
)


def other_words(text: str) -> list[Case]:
    """A text with each word in turn replaced by others."""
    words = text.replace("\n", " \n ").split(" ")
    places = [k for k, word in enumerate(words) if word not in ("", "\n")]
    return [
        Case(f"word {k} is {new[:30]!r}", " ".join([*words[:k], new, *words[k + 1 :]]).encode())
        for k in places
        for new in TOKENS
    ]


def test_obj(campaign):
    path, library = campaign.folder / "scene.obj", campaign.folder / "m.mtl"
    described = "newmtl m\nKd 1 0.5 0\nmap_Kd -s 2 2 1 -o 0 0 t.png\n"
    library.write_text(described)
    Image.fromarray(PIXELS).save(campaign.folder / "t.png")
    campaign.run(other_words(OBJ), path, lambda: read(path))
    campaign.run(damaged_bytes(OBJ.encode(), 40), path, lambda: read(path))
    path.write_text(OBJ)
    campaign.run(other_words(described), library, lambda: read(path))
    campaign.run(damaged_bytes(described.encode(), 40), library, lambda: read(path))
    campaign.end()


PLY = """ply
format ascii 1.0
comment TextureFile t.png
element vertex 4
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face 2
property list uchar int vertex_indices
property list uchar float texcoord
property int texnumber
end_header
0 0 0 1 2 3
0 0 4 1 2 3
4 0 4 1 2 3
4 0 0 1 2 3
3 0 1 2 6 0 0 0 1 1 1 0
3 0 2 3 6 0 0 1 1 1 0 0
"""
HEADER_LINES = (
    "element vertex 99999999999",
    "element vertex -4",
    "element face 4000000000",
    "element face -1",
    "element other 3000000000",
    "property list uchar int",
    "property double x",
    "property list int int extra",
    "format binary_little_endian 1.0",
    "format ascii 9.9",
    "comment TextureFile ../../../etc/hostname",
    f"comment TextureFile {'a' * 5000}.png",
    "element vertex 4 5",
    "x" * 10_000,
    "",
)


def test_ply(campaign):
    path = campaign.folder / "scene.ply"
    Image.fromarray(PIXELS).save(campaign.folder / "t.png")
    binary = io.BytesIO()
    lines = PLY.splitlines()
    kept = [line for line in lines[:14] if "texcoord" not in line and "texnumber" not in line]
    binary.write("\n".join([*kept, "end_header\n"]).replace("ascii", "binary_little_endian").encode())
    for corner in CORNERS:
        binary.write(corner.tobytes() + b"\1\2\3")
    binary.write(b"".join(struct.pack("<B3i", 3, *face) for face in ((0, 1, 2), (0, 2, 3))))
    for whole in (PLY.encode(), binary.getvalue()):  # what is compiled is compiled before the clock starts
        path.write_bytes(whole)
        read(path)
    others = [
        Case(f"line {k} is {new[:40]!r}", "\n".join([*lines[:k], new, *lines[k + 1 :], ""]).encode())
        for k in range(15)
        for new in HEADER_LINES
    ]
    faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n4 0 0 0 0\n"
    vertices = "element vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
    others += texts(f"ply\nformat ascii 1.0\n{vertices}{faces}", "ply\n" + 900 * "\0 " + "\n")
    campaign.run(others, path, lambda: read(path))
    campaign.run(other_words(PLY)[-40 * len(TOKENS) :], path, lambda: read(path))
    campaign.run(damaged_bytes(binary.getvalue(), 120), path, lambda: read(path))
    campaign.end()


def test_no_files(campaign, special_files):
    for path in special_files(".gltf", ".glb", ".obj", ".ply"):
        campaign.call(path.name[:20], lambda path=path: read(path))
    for path in special_files(".png", ".mtl"):
        shape = campaign.folder / "shape.obj"
        if path.suffix == ".png":
            (campaign.folder / "m.mtl").write_text(f"newmtl m\nmap_Kd {path.name}\n")
            shape.write_text(OBJ)
        else:
            shape.write_text(OBJ.replace("m.mtl", path.name))
        campaign.call(f"OBJ with {path.name[:20]}", lambda: read(shape))
        gltf = document(campaign.folder)
        gltf.header["images"][0] = {"uri": path.name}
        scene = gltf.save("shape.gltf")
        campaign.call(f"glTF with {path.name[:20]}", lambda scene=scene: read(scene))
    campaign.end()


def test_texts(campaign):
    for suffix in (".obj", ".ply"):
        path = campaign.folder / f"scene{suffix}"
        campaign.run([*texts("", "\n" * 1000, "ply", "ply\n", "f 1 2 3"), *NO_JSON], path, lambda path=path: read(path))
    campaign.end()
