import numpy as np
import pytest
import trimesh
from PIL import Image

from deux.errors import DeuxError
from deux.mesh_files.mesh_reader import read_mesh, referenced_files

ROOM = trimesh.creation.box(bounds=[[0, 0, 0], [5, 2.5, 4]])


def save(path, vertices=ROOM.vertices, faces=ROOM.faces):
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_vertices_that_are_nowhere(tmp_path, bad):
    unused = save(tmp_path / "unused.ply", np.vstack([[[bad, 0, 0]], ROOM.vertices]), ROOM.faces + 1)
    mesh = read_mesh(unused)
    np.testing.assert_allclose(mesh.triangles, ROOM.triangles)
    assert np.isfinite(mesh.vertices).all()
    vertices = ROOM.vertices.copy()
    vertices[3, 1] = bad
    with pytest.raises(
        DeuxError, match=r"used\.ply is damaged: [4-6] of its faces have a vertex at NaN or infinity\.$"
    ):
        read_mesh(save(tmp_path / "used.ply", vertices))


def test_a_vertex_that_no_face_uses_does_not_count(tmp_path):
    mesh = read_mesh(save(tmp_path / "stray.ply", np.vstack([ROOM.vertices, [[900, 0, 900]]])))
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [5, 2.5, 4]])


def test_stray_triangles_are_left_out_and_reported(tmp_path, caplog):
    far = ROOM.vertices[:3] * 0.1 + 900
    mesh = read_mesh(save(tmp_path / "far.ply", np.vstack([ROOM.vertices, far]), np.vstack([ROOM.faces, [[8, 9, 10]]])))
    np.testing.assert_allclose(mesh.triangles, ROOM.triangles)
    assert len(mesh.uv) == len(mesh.face_material) == len(mesh.face_label) == 12
    assert "1 of 13 triangles are far away" in caplog.text


def test_a_triangle_that_reaches_far_away_is_an_error(tmp_path):
    vertices = ROOM.vertices.copy()
    vertices[vertices.sum(axis=1).argmax()] = 900
    with pytest.raises(DeuxError, match=r"900 x 900 x 900 m large, but a scene must be at most 250 m long"):
        read_mesh(save(tmp_path / "spike.ply", vertices))


def test_scale_and_up_are_applied_in_this_order_of_axes(tmp_path):
    mesh = read_mesh(save(tmp_path / "cm.ply", ROOM.vertices * 100), up="z", scale=0.01)
    np.testing.assert_allclose(mesh.bounds, [[0, 0, -2.5], [5, 4, 0]], atol=1e-6)


@pytest.mark.parametrize("suffix", ["obj", "glb"])
def test_far_coordinates_are_brought_to_the_origin_exactly(tmp_path, suffix):
    offset = np.array([448_000.0, 120.0, 5_411_000.0])
    if suffix == "obj":
        path = tmp_path / "far.obj"
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (ROOM.vertices + offset).tolist()]
        path.write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in (ROOM.faces + 1).tolist())]))
    else:
        path = tmp_path / "far.glb"
        scene = trimesh.Scene()
        scene.add_geometry(ROOM, transform=trimesh.transformations.translation_matrix(offset))
        scene.export(path)
    mesh = read_mesh(path)
    assert mesh.origin == (448_000.0, 0.0, 5_411_000.0)
    np.testing.assert_array_equal(mesh.triangles + mesh.origin, ROOM.triangles + offset)
    assert mesh.vertices.dtype == np.float32


def test_textures_keep_at_most_as_many_pixels(tmp_path):
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 32, 3), np.uint8)).save(tmp_path / "t.png")
    (tmp_path / "m.mtl").write_text("newmtl m\nmap_Kd t.png\nnewmtl n\nmap_Kd t.png\n")
    corners = "v 0 0 0\nv 0 0 4\nv 4 0 4\nv 4 0 0\nvt 0 0\nvt 0 1\nvt 1 1\n"
    faces = "usemtl m\nf 1/1 2/2 3/3\nusemtl n\nf 1/1 3/2 4/3\n"
    (tmp_path / "s.obj").write_text("mtllib m.mtl\n" + corners + faces)
    for limit, shape in ((None, (64, 32, 3)), (16, (16, 8, 3))):
        first, second = read_mesh(tmp_path / "s.obj", max_texture=limit).materials
        assert first.texture.shape == shape
        assert second.texture is first.texture, "an image is kept once"
    assert referenced_files(tmp_path / "s.obj") == [tmp_path / "m.mtl", tmp_path / "t.png"]


def test_parts_of_one_file_share_their_vertices(tmp_path):
    corners = "v 0 0 0 1 0 0\nv 0 0 4\nv 4 0 4\nv 4 0 0 0 0 1\n"
    (tmp_path / "s.obj").write_text(corners + "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n")
    mesh = read_mesh(tmp_path / "s.obj")
    assert len(mesh.vertices) == len(mesh.vertex_colors) == 4
    np.testing.assert_array_equal(mesh.vertex_colors[[0, 3]], [[255, 0, 0], [0, 0, 255]])
    assert [mesh.materials[k].name for k in mesh.face_material] == ["a", "b"]
