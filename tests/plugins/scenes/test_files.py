import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from deux.collection.walk import Walk, run_walks
from deux.contracts import Robot, SceneArea, SceneSource
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.options import construct, full_settings
from deux.simulator.mesh_simulator import MeshSimulator
from deux.testing.scenes import SceneSourceSuite
from deux_plugins.explorers.frontier import FrontierExplorer
from deux_plugins.scenes.files import FileReference, Files, check_scene_file, file_identity, load_scene

SQUARE = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 4], [0, 0, 4]], np.float32)
TWO_TRIANGLES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
GLTF_UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)  # origin at the image's top left
CORNER_COLORS = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 8, 7, 255]], np.uint8)


@pytest.fixture
def boxes(tmp_path):
    """Three different scene files, a.ply, b.ply and c.ply, and the path of each."""
    paths = []
    for size, name in enumerate("abc", start=3):
        paths.append(str(tmp_path / f"{name}.ply"))
        trimesh.creation.box([size] * 3).export(paths[-1])
    return paths


class TestFiles(SceneSourceSuite):
    @pytest.fixture(autouse=True)
    def _files(self, boxes):
        self.boxes = boxes

    def make_source(self) -> SceneSource:
        return Files(*self.boxes)


@pytest.fixture
def picture(tmp_path):
    """wall.png, 16 x 8 pixels of noise."""
    pixels = np.random.default_rng(6).integers(0, 255, (8, 16, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "wall.png")
    return pixels


def write_gltf(path: Path) -> Path:
    """A file with every way to colour a square, two nodes for one mesh, and a line.

    Meshes: 0 textured and tinted, 1 the same texture untinted, 2 a base colour, 3 vertex colours, 4 a line, 5 nothing.
    """
    blobs = [SQUARE, TWO_TRIANGLES, GLTF_UV, CORNER_COLORS]
    types = [(5126, "VEC3"), (5123, "SCALAR"), (5126, "VEC2"), (5121, "VEC4")]
    path.with_suffix(".bin").write_bytes(b"".join(blob.tobytes() for blob in blobs))
    offsets = np.cumsum([0, *(blob.nbytes for blob in blobs)])[:-1].tolist()
    corners, textured = {"POSITION": 0}, {"POSITION": 0, "TEXCOORD_0": 2}
    primitives = [
        {"attributes": textured, "indices": 1, "material": 0},
        {"attributes": textured, "indices": 1, "material": 1},
        {"attributes": corners, "indices": 1, "material": 2},
        {"attributes": {**corners, "COLOR_0": 3}, "indices": 1},
        {"attributes": corners, "mode": 1},
        {"attributes": corners, "indices": 1},
    ]
    nodes = [{"mesh": k, "translation": [5.0 * k, 0, 0]} for k in range(6)]
    nodes.append({"mesh": 0, "translation": [0, 0, 5], "scale": [2, 2, 2]})
    texture = {"index": 0}
    materials = [
        {
            "name": "tinted",
            "pbrMetallicRoughness": {"baseColorTexture": texture, "baseColorFactor": [1, 0.5, 0, 1]},
        },
        {"name": "plain", "pbrMetallicRoughness": {"baseColorTexture": texture}},
        {"name": "paint", "pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.6, 1]}},
    ]
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": [{"primitives": [primitive]} for primitive in primitives],
        "materials": materials,
        "textures": [{"source": 0}],
        "images": [{"uri": "wall.png"}],
        "buffers": [{"uri": path.with_suffix(".bin").name, "byteLength": sum(blob.nbytes for blob in blobs)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": offset, "byteLength": blob.nbytes}
            for offset, blob in zip(offsets, blobs, strict=True)
        ],
        "accessors": [
            {
                "bufferView": k,
                "componentType": component,
                "type": kind,
                "count": blob.size if kind == "SCALAR" else 4,
            }
            for k, (blob, (component, kind)) in enumerate(zip(blobs, types, strict=True))
        ],
    }
    header["accessors"][0] |= {"min": [0, 0, 0], "max": [4, 0, 4]}
    path.write_text(json.dumps(header))
    return path


def texel(texture, uv):
    """The pixel under texture coordinates, as trimesh rounds them."""
    height, width = texture.shape[:2]
    columns = (uv[:, 0] * (width - 1)).round().astype(int) % width
    rows = ((1 - uv[:, 1]) * (height - 1)).round().astype(int) % height
    return texture[rows, columns]


def test_gltf_colours_transforms_and_instances(tmp_path, picture):
    mesh = load_scene(write_gltf(tmp_path / "rooms.gltf")).mesh
    assert len(mesh.faces) == 2 * 6, "six squares; the line is left out"
    by_name = {material.name: material for material in mesh.materials}
    tinted, plain, paint = by_name["tinted"], by_name["plain"], by_name["paint"]
    assert (tinted.color, plain.color, paint.color) == ((255, 128, 0), (255, 255, 255), (51, 102, 153))
    assert sum(material.texture is not None for material in mesh.materials) == 2
    np.testing.assert_array_equal(plain.texture, picture)
    assert tinted.texture is plain.texture, "one image is kept once"

    corners = mesh.triangles.reshape(-1, 6, 3)
    extents = sorted(map(tuple, np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)[:, [0, 2, 3, 5]]))
    assert extents == [
        (0, 0, 4, 4),
        (0, 5, 8, 13),
        (5, 0, 9, 4),
        (10, 0, 14, 4),
        (15, 0, 19, 4),
        (25, 0, 29, 4),
    ]

    # The corner at the origin has the picture's top left pixel, (u, v) = (0, 1) from the bottom left.
    at_origin = np.argwhere((mesh.triangles == 0).all(axis=2))[0]
    np.testing.assert_array_equal(mesh.uv[tuple(at_origin)], [0, 1])


def test_gltf_vertex_colours(tmp_path, picture):
    mesh = load_scene(write_gltf(tmp_path / "rooms.gltf")).mesh
    for x, z, color in [(15, 0, CORNER_COLORS[0]), (19, 4, CORNER_COLORS[2])]:
        here = (mesh.vertices == (x, 0, z)).all(axis=1)
        np.testing.assert_array_equal(mesh.vertex_colors[here], [color[:3]])
    painted = (mesh.vertices[:, 0] >= 10) & (mesh.vertices[:, 0] <= 14)
    assert (mesh.vertex_colors[painted] == 255).all(), "vertices without a colour change nothing"


def test_obj_with_material_library(tmp_path, picture):
    (tmp_path / "flat.mtl").write_text("newmtl wall\nKd 0 0 0\nmap_Kd wall.png\nnewmtl red\nKd 1 0 0\n")
    square = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    faces = "usemtl wall\nf 1/1 2/2 3/3\nusemtl red\nf 1/1 3/3 4/4\n"
    (tmp_path / "flat.obj").write_text("mtllib flat.mtl\n" + square + faces)
    mesh = load_scene(tmp_path / "flat.obj").mesh
    by_name = {material.name: material for material in mesh.materials}
    np.testing.assert_array_equal(by_name["wall"].texture, picture)
    assert by_name["wall"].color == (255, 255, 255), "a textured material's Kd is not to be relied on"
    assert (by_name["red"].color, by_name["red"].texture) == ((255, 0, 0), None)
    wall = [mesh.materials[k].name == "wall" for k in mesh.face_material]
    np.testing.assert_array_equal(np.sort(mesh.uv[wall].reshape(-1, 2), axis=0), [[0, 0], [1, 0], [1, 1]])


def test_ply_face_colours_are_not_blended(tmp_path):
    box = trimesh.creation.box([4, 4, 4])
    colors = np.random.default_rng(4).integers(0, 255, (12, 4), dtype=np.uint8)
    box.visual.face_colors = colors
    box.export(tmp_path / "box.ply")
    mesh = load_scene(tmp_path / "box.ply").mesh
    np.testing.assert_array_equal(mesh.vertex_colors[mesh.faces], np.repeat(colors[:, None, :3], 3, axis=1))
    np.testing.assert_allclose(mesh.triangles, box.triangles)


def test_a_file_without_colours_is_grey(tmp_path):
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 4 0 0\nv 4 0 4\nf 1 2 3\n")
    mesh = load_scene(tmp_path / "bare.obj").mesh
    assert mesh.vertex_colors is None
    (material,) = mesh.materials
    assert material.texture is None
    assert len(set(material.color)) == 1


def test_z_up_files_are_turned(tmp_path):
    box = trimesh.creation.box(bounds=[[0, 0, 0], [5, 2, 3]])
    box.export(tmp_path / "box.ply")
    turned = load_scene(tmp_path / "box.ply", up="z")
    np.testing.assert_allclose(turned.mesh.bounds, [[0, 0, -2], [5, 3, 0]])
    assert turned.identity != load_scene(tmp_path / "box.ply").identity
    corner = load_scene(tmp_path / "box.ply").mesh.vertices, turned.mesh.vertices
    np.testing.assert_allclose(corner[1], np.stack([corner[0][:, 0], corner[0][:, 2], -corner[0][:, 1]], axis=1))


def test_identity_is_the_content_not_the_place(tmp_path, picture):
    first, second = tmp_path, tmp_path / "copy"
    second.mkdir()
    one = write_gltf(first / "rooms.gltf")
    for name in ("rooms.gltf", "rooms.bin", "wall.png"):
        (second / name).write_bytes((first / name).read_bytes())
    assert file_identity(one) == file_identity(second / "rooms.gltf")
    assert file_identity(one) == load_scene(one).identity
    assert file_identity(one).startswith("file:")
    Image.fromarray(picture[::-1]).save(second / "wall.png")
    assert file_identity(one) != file_identity(second / "rooms.gltf"), "its textures are part of a scene"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.glb", None, "no scene file"),
        ("scene.fbx", b"", "must end in one of"),
        ("broken.glb", b"glTF nothing", "is truncated to 12 bytes"),
        ("broken.gltf", b"{", "is damaged or not JSON"),
        ("broken.ply", b"ply\nformat", "is damaged or not a .ply file"),
        ("empty.obj", b"v 0 0 0\n", "a scene needs surfaces"),
        ("wall.obj", b"v 0 0 0\nv 4 0 0\nv 4 3 0\nf 1 2 3\n", "no floor"),
        ("inches.obj", b"v 0 0 0\nv 4000 0 0\nv 4000 0 4000\nf 1 2 3\n", "is it in metres"),
        ("paint.obj", b"mtllib paint.mtl\nv 0 0 0\nv 4 0 0\nv 4 0 4\nf 1 2 3\n", r"needs paint\.mtl"),
    ],
)
def test_mistakes_are_named_with_the_file(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(DeuxError, match=message) as error:
        load_scene(tmp_path / name)
    assert str(tmp_path / name) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("part", ["wall.png", "rooms.bin"])
def test_a_missing_or_broken_part_is_named(tmp_path, picture, part):
    path = write_gltf(tmp_path / "rooms.gltf")
    content = (tmp_path / part).read_bytes()
    (tmp_path / part).write_bytes(content[: len(content) // 2])
    with pytest.raises(DeuxError, match="cannot be read"):
        load_scene(path)
    (tmp_path / part).unlink()
    with pytest.raises(DeuxError, match=f"needs {part}"):
        load_scene(path)


def test_a_missing_file_is_answered_by_what_lies_beside_it(tmp_path):
    with pytest.raises(DeuxError, match=r"no scene file .*house\.glb: there is: none\.$"):
        check_scene_file(tmp_path / "house.glb")
    (tmp_path / "small_house.glb").touch()
    (tmp_path / "notes.txt").touch()
    with pytest.raises(DeuxError, match=r"did you mean small_house\.glb\? There is: small_house\.glb\.$"):
        check_scene_file(tmp_path / "smal_house.glb")
    with pytest.raises(DeuxError, match=r"there is no folder .*/nowhere\.$"):
        check_scene_file(tmp_path / "nowhere" / "house.glb")


def test_files_load_from_anywhere_under_one_identity(boxes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    splits = Files(train=["a.ply", "b.ply"], test="c.ply").splits()
    monkeypatch.chdir("/")
    assert [scene.name for scene in (*splits.train, *splits.test)] == ["a", "b", "c"]
    scene = splits.train[0].load()
    assert (scene.name, scene.identity) == ("a", splits.train[0].identity)
    other = tmp_path / "elsewhere.ply"
    other.write_bytes((tmp_path / "a.ply").read_bytes())
    assert FileReference("other", other).identity == scene.identity
    assert splits.train[1].identity != scene.identity


def test_a_tilde_is_the_home_folder(boxes, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir("/")
    assert Files("~/a.ply").splits().train[0].file == tmp_path / "a.ply"


def test_a_changed_file_gets_a_new_identity(boxes, tmp_path):
    reference = FileReference("a", tmp_path / "a.ply")
    before = reference.identity
    trimesh.creation.box([9, 9, 9]).export(reference.path)
    os.utime(reference.path, (1, 1))
    assert reference.identity != before


def test_up_reaches_the_scene(boxes):
    trimesh.creation.box([4, 2, 9]).export(boxes[0])
    (lying,) = Files(boxes[0], up="z").splits().train
    assert lying.load().mesh.bounds[1].tolist() == [2.0, 4.5, 1.0]
    assert lying.identity != Files(boxes[0]).splits().train[0].identity


def test_equal_stems_are_told_apart_by_their_folders(tmp_path):
    for height, folder in enumerate(("office", "hotel"), start=3):
        (tmp_path / folder).mkdir()
        trimesh.creation.box([4, height, 4]).export(tmp_path / folder / "mesh.ply")
    train, test = (str(tmp_path / folder / "mesh.ply") for folder in ("office", "hotel"))
    splits = Files(train, test=test).splits()
    assert (splits.train[0].name, splits.test[0].name) == ("office_mesh", "hotel_mesh")
    assert splits.train[0].load().name == "office_mesh"


def test_a_file_in_two_splits_must_be_allowed_by_the_option_that_the_error_names(boxes):
    settings = {"train": boxes, "test": boxes[:1]}
    with pytest.raises(DeuxError, match=r"a\.ply is in scenes\.train and scenes\.test") as error:
        construct(Files, settings, "scenes")
    assert str(error.value).endswith("set scenes.allow_overlap=true.")
    splits = construct(Files, {**settings, "allow_overlap": True}, "scenes").splits()
    assert splits.test[0] == splits.train[0]


def test_copies_and_links_are_the_scene_that_they_are_of(boxes, tmp_path, caplog):
    copy, link = tmp_path / "copy.ply", tmp_path / "link.ply"
    copy.write_bytes((tmp_path / "a.ply").read_bytes())
    link.symlink_to(tmp_path / "a.ply")
    for other in (copy, link):
        with pytest.raises(DeuxError, match=rf"a\.ply is in scenes\.train and, as .*{other.name}, in scenes\.test"):
            Files(boxes, test=str(other))
    assert Files(boxes, test=str(copy), allow_overlap=True).splits().test[0].name == "copy"
    (scene,) = Files([boxes[0], str(copy)]).splits().train
    assert scene.name == "a"
    assert "copy.ply of scenes.train is the same as" in caplog.text


def test_scale_and_textures_are_options_and_part_of_the_identity(boxes):
    trimesh.creation.box([400, 300, 400]).export(boxes[0])
    with pytest.raises(DeuxError, match=r"scenes\.scale=0\.01"):
        Files(boxes[0]).splits().train[0].load()
    (scaled,) = Files(boxes[0], scale=0.01).splits().train
    np.testing.assert_allclose(scaled.load().mesh.bounds, [[-2, -1.5, -2], [2, 1.5, 2]])
    (small,) = Files(boxes[0], scale=0.01, max_texture=512).splits().train
    assert len({scaled.identity, small.identity, FileReference("a", scaled.path).identity}) == 3
    for settings, message in (({"scale": 0.0}, r"scenes\.scale"), ({"max_texture": 0}, r"scenes\.max_texture")):
        with pytest.raises(DeuxError, match=message):
            Files(boxes[0], **settings)


@pytest.fixture
def colored_rooms(tmp_path):
    """A room with a box in it, at the origin and far away: origin.glb, far.glb and how far."""
    offset = np.array([448_000.0, 120.0, 5_411_000.0])
    room = trimesh.util.concatenate(
        [trimesh.creation.box(bounds=[[0, 0, 0], [7, 2.5, 5]]), trimesh.creation.box(bounds=[[2, 0, 1.5], [3, 1.5, 4]])]
    ).subdivide()
    room.visual.vertex_colors = np.random.default_rng(0).integers(0, 256, (len(room.vertices), 4), np.uint8)
    for name, move in (("origin", 0 * offset), ("far", offset)):
        scene = trimesh.Scene()
        scene.add_geometry(room, transform=trimesh.transformations.translation_matrix(move))
        scene.export(tmp_path / f"{name}.glb")
    return tmp_path / "origin.glb", tmp_path / "far.glb", offset


def test_an_exploration_far_from_the_origin_records_the_same_frames(colored_rooms):
    *paths, offset = colored_rooms
    simulators = [MeshSimulator(FileReference("room", path), Camera(48, 48), Robot()) for path in paths]
    near, far = (simulator.free_space() for simulator in simulators)
    np.testing.assert_array_equal(near.free, far.free)
    assert (far.frame.origin_x, far.frame.origin_z, far.floor_height) == (offset[0], offset[2], offset[1])
    assert simulators[1].floors[0].height == offset[1]
    walks = [Walk(simulator, FrontierExplorer(), 3, 60) for simulator in simulators]
    for one, other in run_walks(walks):
        assert one.action == other.action
        np.testing.assert_array_equal(one.frame.rgb, other.frame.rgb)
        np.testing.assert_array_equal(one.frame.depth, other.frame.depth)
        np.testing.assert_allclose(other.frame.pose[:3, 3] - one.frame.pose[:3, 3], offset, rtol=0, atol=1e-8)
    assert len(walks[0].actions) == 60


def test_options_have_defaults_that_json_holds():
    assert full_settings(Files, {"train": "a.ply"}) == {
        "train": "a.ply",
        "validation": None,
        "test": None,
        "up": "y",
        "scale": 1.0,
        "max_texture": None,
        "prepared": None,
        "allow_overlap": False,
        "floor": "largest",
        "region": None,
        "start": None,
    }


def test_the_area_reaches_every_scene(boxes):
    source = construct(Files, {"train": str(boxes[0]), "test": str(boxes[1]), "floor": 1, "start": [1, 2.5]}, "scenes")
    splits = source.splits()
    assert {scene.area for scene in (*splits.train, *splits.test)} == {SceneArea(1, None, (1.0, 2.5))}
    assert Files(boxes[0]).splits().train[0].area == SceneArea()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"train": 3}, r"scenes\.train must be text or a list \(each text\)"),
        ({"train": [3]}, r"scenes\.train must be"),
        ({"train": "nowhere.ply"}, "no scene file"),
        ({"train": ["a.ply", "a.ply"]}, "list it once"),
        ({"train": "a.ply", "up": "x"}, r"scenes\.up cannot be 'x': there is: y, z"),
        ({"train": "a.ply", "upp": "z"}, "did you mean up"),
        ({"train": "a.ply", "floor": "upper"}, r"scenes\.floor must be a whole number or 'largest' or 'all'"),
        ({"train": "a.ply", "region": [2, 0, 1, 1]}, r"scenes\.region is \[2.0, 0.0, 1.0, 1.0\], but must be \[x_min"),
        ({"train": "a.ply", "allow_overlap": 1}, r"scenes\.allow_overlap must be true or false"),
    ],
)
def test_mistaken_options_are_one_sentence(boxes, tmp_path, monkeypatch, settings, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DeuxError, match=message) as error:
        construct(Files, settings, "scenes").splits()
    assert "\n" not in str(error.value)


def test_small_house_has_the_colours_that_trimesh_samples(shared_data, small_house):
    mesh = small_house.mesh
    loaded = trimesh.load_scene(shared_data("scenes") / "small_house.glb")
    rng = np.random.default_rng(5)
    first_face = {material.name: np.argmax(mesh.face_material == k) for k, material in enumerate(mesh.materials)}
    for node in loaded.graph.nodes_geometry:
        geometry = loaded.geometry[loaded.graph[node][1]]
        first = first_face[geometry.visual.material.name]
        faces = rng.integers(0, len(geometry.faces), 20)
        weights = rng.dirichlet([1, 1, 1], 20)
        material = mesh.materials[mesh.face_material[first + faces[0]]]
        uv = np.einsum("fk,fkc->fc", weights, geometry.visual.uv[geometry.faces[faces]])
        expected = geometry.visual.material.to_color(uv)[..., :3]
        if material.texture is None:
            np.testing.assert_array_equal(material.color, expected)
        else:
            assert material.color == (255, 255, 255)
            ours = texel(material.texture, np.einsum("fk,fkc->fc", weights, mesh.uv[first + faces]))
            # float32 coordinates may round to the neighbouring pixel.
            assert (ours == expected).all(axis=1).mean() >= 0.9
    assert len(mesh.faces) == 145_937
    assert sum(material.texture is None for material in mesh.materials) == 2


def test_small_house_has_the_colours_that_habitat_renders(shared_data, small_house, house_caster):
    mesh = small_house.mesh
    with np.load(shared_data("habitat") / "pose_05.npz") as view:
        rgb, depth, world_to_camera = view["rgb"], view["depth"], view["camera_matrix_world_to_cam"]
    v, u = np.mgrid[4:400:8, 4:400:8].reshape(2, -1)
    rays = np.stack([(u + 0.5 - 200) / 200, -(v + 0.5 - 200) / 200, -np.ones(len(u))], axis=-1)
    camera_to_world = np.linalg.inv(world_to_camera)
    origins = np.tile(camera_to_world[:3, 3], (len(u), 1))
    hits = house_caster.cast(origins, rays @ camera_to_world[:3, :3].T)
    met = hits.face >= 0
    np.testing.assert_allclose(hits.distance[met], depth[v, u][met], rtol=0, atol=0.05)
    error = []
    for k in np.flatnonzero(met):
        face = hits.face[k]
        material = mesh.materials[mesh.face_material[face]]
        color = np.array(material.color, float)
        if material.texture is not None:
            b, c = hits.barycentric[k]
            uv = np.array([1 - b - c, b, c]) @ mesh.uv[face]
            color = color * texel(material.texture, uv[None])[0] / 255
        error.append(np.abs(color - rgb[v[k], u[k]]).mean())
    assert np.median(error) < 3.0
    assert np.mean(error) < 15.0


def test_lounge_has_its_vertex_colours(shared_data, lounge):
    content = (shared_data("scenes") / "lounge.ply").read_bytes()
    start = content.index(b"end_header\n") + len(b"end_header\n")
    vertex = struct.Struct("<dddBBB")  # as its header says: x, y, z, red, green, blue
    for index in (0, 1000, 100_000):
        values = vertex.unpack_from(content, start + index * vertex.size)
        np.testing.assert_allclose(lounge.mesh.vertices[index], values[:3], rtol=1e-6)
        np.testing.assert_array_equal(lounge.mesh.vertex_colors[index], values[3:])
    assert lounge.name == "lounge"
    assert len(lounge.mesh.faces) == 500_000
