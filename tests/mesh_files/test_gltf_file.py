import logging

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from trimesh import transformations

from deux.errors import DeuxError
from deux.mesh_files.gltf_file import read_gltf

BOX = trimesh.creation.box(bounds=[[1, 2, 3], [2, 4, 7]])
VOLUME = 8.0


@pytest.fixture
def box(gltf):
    """A writer with one box."""
    gltf.primitive({"POSITION": np.asarray(BOX.vertices, np.float32)}, np.asarray(BOX.faces, np.uint8).reshape(-1))
    return gltf


def parts_as_meshes(path):
    return [trimesh.Trimesh(part.vertices, part.faces, process=False) for part in read_gltf(path)]


def moved(*matrices):
    """The corners of the box, moved by the product of matrices."""
    return transformations.transform_points(BOX.vertices, np.linalg.multi_dot([*matrices, np.eye(4)]))


def quaternion(axis, angle):
    """x, y, z, w."""
    w, x, y, z = transformations.quaternion_about_axis(angle, axis)
    return [x, y, z, w]


def test_transforms_of_nested_nodes(box):
    turned = transformations.rotation_matrix(0.7, [1, 2, 3], [4, 5, 6])
    box.header["nodes"] = [
        {"translation": [5, 6, 7], "rotation": quaternion([0, 1, 1], 0.4), "scale": [1, 2, 3], "children": [2, 1]},
        {"mesh": 0, "scale": [2, 2, 2]},
        {"matrix": turned.T.reshape(-1).tolist(), "mesh": 0},
    ]
    scale = np.diag([1, 2, 3, 1])
    parent = transformations.translation_matrix([5, 6, 7]) @ transformations.rotation_matrix(0.4, [0, 1, 1]) @ scale
    first, second = read_gltf(box.save())
    np.testing.assert_allclose(first.vertices, moved(parent, turned))
    np.testing.assert_allclose(second.vertices, moved(parent, np.diag([2, 2, 2, 1])))
    assert first.material is second.material


@pytest.mark.parametrize(
    ("change", "drawn"),
    [
        ({}, [0]),
        ({"scene": 1}, [1, 2]),
        ({"scene": None}, [0]),
        ({"scenes": None, "scene": None}, [0, 1, 2]),
        ({"scenes": [{}]}, []),
    ],
)
def test_only_the_default_scene_is_drawn(box, change, drawn):
    nodes = [{"mesh": 0, "translation": [10 * k, 0, 0]} for k in range(3)]
    box.header |= {"nodes": nodes, "scenes": [{"nodes": [0]}, {"nodes": [1, 2]}]} | change
    box.header = {key: value for key, value in box.header.items() if value is not None}
    assert [part.vertices[:, 0].min() // 10 for part in read_gltf(box.save())] == drawn


@pytest.mark.parametrize("children", [{0: [1], 1: [0]}, {0: [0]}, {0: [1, 2], 1: [2]}])
def test_nodes_that_are_no_tree_are_refused(box, children):
    box.header["nodes"] = [{"mesh": 0, "children": children.get(k, [])} for k in range(3)]
    with pytest.raises(DeuxError, match=r"its scene is damaged: nodes\[\d\] has two parents, but nodes must be a tree"):
        read_gltf(box.save())


def test_deep_nesting(box):
    box.header["nodes"] = [{"translation": [1, 0, 0], "children": [k + 1]} for k in range(3000)]
    box.header["nodes"].append({"mesh": 0})
    (part,) = read_gltf(box.save())
    np.testing.assert_allclose(part.vertices, BOX.vertices + np.array([3000, 0, 0]))


@pytest.mark.parametrize("scale", [[-1, 1, 1], [-1, -1, 1], [-2, -2, -2]])
def test_mirrored_surfaces_face_outwards(box, scale):
    box.header["nodes"][0]["scale"] = scale
    (mesh,) = parts_as_meshes(box.save())
    assert mesh.volume == pytest.approx(VOLUME * abs(np.prod(scale)))


def test_mirrored_corners_keep_their_coordinates(gltf):
    uv = np.array([[0, 0], [1, 0], [0, 0.5]], np.float32)
    material = gltf.textured(gltf.image(np.zeros((2, 2, 3), np.uint8)))
    gltf.primitive({"POSITION": np.c_[uv, np.ones(3)].astype(np.float32), "TEXCOORD_0": uv}, material=material)
    gltf.header["nodes"][0]["scale"] = [-1, 1, 1]
    (part,) = read_gltf(gltf.save())
    np.testing.assert_allclose(part.uv * [1, -1] + [0, 1], part.vertices[part.faces][..., :2] * [-1, 1])


def test_instances(box):
    """EXT_mesh_gpu_instancing: world = node x translation x rotation x scale of each instance."""
    rng = np.random.default_rng(8)
    translations, scales = rng.normal(size=(2, 5, 3)).astype(np.float32)
    turns = np.round(Rotation.random(5, rng=rng).as_quat() * 32767).astype(np.int16)
    attributes = {
        "TRANSLATION": box.accessor(translations),
        "ROTATION": box.accessor(turns, normalized=True),
        "SCALE": box.accessor(np.abs(scales)),
        "_ID": box.accessor(np.arange(5, dtype=np.float32)),
    }
    box.header["nodes"][0] |= {
        "translation": [0, 9, 0],
        "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}},
    }
    box.require("EXT_mesh_gpu_instancing")
    parts = read_gltf(box.save())
    assert len(parts) == 5
    for part, move, (x, y, z, w), scale in zip(parts, translations, turns, np.abs(scales), strict=True):
        matrices = [transformations.translation_matrix(v) for v in ([0, 9, 0], move)]
        turn = transformations.quaternion_matrix([w, x, y, z])
        np.testing.assert_allclose(part.vertices, moved(*matrices, turn, np.diag([*scale, 1])), atol=1e-9)


def test_instances_of_some_attributes_only(box):
    attributes = {"TRANSLATION": box.accessor(np.array([[0, 0, 0], [10, 0, 0]], np.float32))}
    box.header["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    first, second = read_gltf(box.save())
    np.testing.assert_allclose(first.vertices, BOX.vertices)
    np.testing.assert_allclose(second.vertices, BOX.vertices + np.array([10, 0, 0]))


def test_more_instances_than_memory_has_room_for_are_refused(box, leave_memory):
    places = box.add("accessors", {"count": 50_000, "componentType": 5126, "type": "VEC3"})
    box.header["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
    box.require("EXT_mesh_gpu_instancing")
    leave_memory(200_000_000)
    with pytest.raises(DeuxError, match=r"with 600,000 triangles in 50,000 placed surfaces would take .* GiB"):
        read_gltf(box.save())


def test_skins_are_drawn_where_their_joints_are(box):
    """Half of the box hangs on either joint; the transform of the box's own node does not count."""
    count = len(BOX.vertices)
    weights = np.zeros((count, 4), np.float32)
    weights[:, :2] = np.where(np.asarray(BOX.vertices)[:, :1] > 1.5, [[0.25, 0.75]], [[1, 0]])
    joints = np.tile(np.array([1, 0, 0, 0], np.uint8), (count, 1))
    entry = box.header["meshes"][0]["primitives"][0]
    entry["attributes"] |= {"JOINTS_0": box.accessor(joints), "WEIGHTS_0": box.accessor(weights)}
    binds = [transformations.translation_matrix([0, -k, 0]) for k in (1, 2)]
    stored = np.stack([bind.T.reshape(-1) for bind in binds]).astype(np.float32)
    inverse = box.add(
        "accessors",
        {"bufferView": box.view(stored.tobytes()), "componentType": 5126, "count": 2, "type": "MAT4"},
    )
    box.header["skins"] = [{"joints": [1, 2], "inverseBindMatrices": inverse}]
    box.header["nodes"] = [
        {"mesh": 0, "skin": 0, "scale": [100, 100, 100]},
        {"translation": [0, 1, 0], "children": [2]},
        {"translation": [0, 1, 0], "rotation": quaternion([1, 0, 0], 0.5)},
    ]
    box.header["scenes"] = [{"nodes": [0, 1]}]
    (part,) = read_gltf(box.save())
    first = transformations.translation_matrix([0, 1, 0])
    second = first @ transformations.translation_matrix([0, 1, 0]) @ transformations.rotation_matrix(0.5, [1, 0, 0])
    expected = weights[:, :1] * moved(second, binds[1]) + weights[:, 1:2] * moved(first, binds[0])
    np.testing.assert_allclose(part.vertices, expected, atol=1e-6)

    box.header["scenes"] = [{"nodes": [0]}]
    with pytest.raises(DeuxError, match=r"skins\[0\] has the joint nodes\[1\], which is not in the scene"):
        read_gltf(box.save())


def test_hidden_nodes_are_not_drawn(box):
    box.header["nodes"] = [
        {"mesh": 0, "children": [1], "extensions": {"KHR_node_visibility": {"visible": False}}},
        {"mesh": 0},
        {"mesh": 0, "translation": [10, 0, 0]},
    ]
    box.header["scenes"] = [{"nodes": [0, 2]}]
    (part,) = read_gltf(box.save())
    np.testing.assert_allclose(part.vertices, BOX.vertices + np.array([10, 0, 0]))


def test_what_is_left_out_is_counted(box, caplog):
    line = np.array([[0, 0, 0], [1, 0, 0]], np.float32)
    for mode in (0, 1, 2, 3):
        box.primitive({"POSITION": line}, mode=mode)
    box.primitive({"NORMAL": line})
    box.header["scenes"].append({"nodes": []})
    box.header["extensionsUsed"] = ["ACME_doors", "KHR_lights_punctual"]
    box.header["nodes"] = [{"mesh": 0}, {"mesh": 0}]
    with caplog.at_level(logging.INFO):
        assert len(read_gltf(box.save())) == 1
    (record,) = caplog.records
    assert record.getMessage().endswith(
        "scene.gltf: left out: 3 primitives of lines; 1 primitives of points; 1 primitives of triangles without "
        "positions; 1 other scenes than scenes[0]; the optional extensions ACME_doors"
    )


def test_extensions_of_light_are_nothing_to_see(box, caplog):
    box.require("KHR_lights_punctual", "KHR_materials_variants", "KHR_materials_transmission")
    with caplog.at_level(logging.INFO):
        assert len(read_gltf(box.save())) == 1
    assert not caplog.records


def test_a_wrong_node_is_named(box):
    box.header["nodes"][0]["mesh"] = 4
    with pytest.raises(DeuxError, match=r"meshes\[4\] is damaged: it refers to meshes\[4\], but there are 1 meshes"):
        read_gltf(box.save())
    box.header["nodes"][0] = {"mesh": 0, "matrix": [1, 2, 3]}
    with pytest.raises(DeuxError, match=r"nodes\[0\].matrix is \[1, 2, 3\], but must be a list of 16 values"):
        read_gltf(box.save())


def test_small_house_is_what_trimesh_reads(shared_data):
    path = shared_data("scenes") / "small_house.glb"
    loaded = trimesh.load_scene(path, process=False)
    theirs = {}
    for node in loaded.graph.nodes_geometry:
        transform, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        theirs[mesh.visual.material.name] = (trimesh.transform_points(mesh.vertices, transform)[mesh.faces], mesh)
    parts = read_gltf(path)
    assert sorted(part.material.name for part in parts) == sorted(theirs)
    for part in parts:
        triangles, mesh = theirs[part.material.name]
        np.testing.assert_array_equal(part.vertices[part.faces], triangles)
        image = mesh.visual.material.baseColorTexture
        if image is None:
            assert part.material.texture is None
        else:
            np.testing.assert_array_equal(part.material.texture, image.convert("RGB"))
            np.testing.assert_allclose(part.uv, mesh.visual.uv[mesh.faces], atol=1e-6)
