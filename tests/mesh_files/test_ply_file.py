import numpy as np
import pytest
import trimesh
from PIL import Image

from deux.errors import DeuxError
from deux.mesh_files.mesh_parts import GREY, MeshPart
from deux.mesh_files.ply_file import read_ply, referenced_by_ply

XYZ = "property float x\nproperty float y\nproperty float z\n"
FACE = "property list uchar int vertex_indices\n"
SQUARE = ["0 0 0", "0 0 4", "4 0 4", "4 0 0"]


@pytest.fixture
def read(tmp_path):
    """A function that writes a text PLY of vertices and faces with further properties, and reads it."""

    def write_and_read(
        faces: list[str], vertex: str = "", face: str = "", vertices: list[str] = SQUARE, comments: str = ""
    ) -> list[MeshPart]:
        header = f"ply\nformat ascii 1.0\n{comments}element vertex {len(vertices)}\n{XYZ}{vertex}"
        header += f"element face {len(faces)}\n{FACE}{face}end_header\n"
        (tmp_path / "scan.ply").write_text(header + "\n".join([*vertices, *faces]) + "\n")
        return read_ply(tmp_path / "scan.ply")

    return write_and_read


@pytest.fixture
def picture(tmp_path):
    """Write a picture of one colour under a name in the folder of the scene."""
    return lambda name, color: Image.new("RGB", (4, 4), color).save(tmp_path / name)


def area(part: MeshPart) -> float:
    return trimesh.Trimesh(part.vertices, part.faces, process=False).area


def properties(kind: str, *names: str) -> str:
    return "".join(f"property {kind} {name}\n" for name in names)


def test_triangles_quads_and_concave_polygons_in_one_file(read):
    corners = [(2, 4), (2, 2), (4, 2), (4, 0), (0, 0), (0, 4)]
    (part,) = read(["6 0 1 2 3 4 5", "4 0 1 3 4", "3 0 4 5"], vertices=[f"{x} 0 {z}" for x, z in corners])
    assert area(part) == pytest.approx(12 + 6 + 4)


def test_textures_are_chosen_face_by_face(read, picture):
    picture("t 0.png", (255, 0, 0))
    picture("t1.png", (0, 0, 255))
    parts = read(
        ["3 0 1 2 6 0 0 1 0 1 1 1", "3 0 2 3 6 .5 0 .5 1 .5 .25 0", "3 1 2 3 0 0", "4 0 1 2 3 8 0 0 0 1 1 1 1 0 -1"],
        face="property list uchar float texcoord\nproperty int texnumber\n",
        comments="comment TextureFile t 0.png\ncomment TextureFile t1.png\n",
    )
    by_color = {None if p.material.texture is None else tuple(p.material.texture[0, 0].tolist()): p for p in parts}
    np.testing.assert_array_equal(by_color[0, 0, 255].uv, [[[0, 0], [1, 0], [1, 1]]])
    np.testing.assert_array_equal(by_color[255, 0, 0].uv, [[[0.5, 0], [0.5, 1], [0.5, 0.25]]])
    np.testing.assert_array_equal(by_color[255, 0, 0].faces, [[0, 2, 3]])
    plain = by_color[None]
    assert (plain.uv, plain.material.color, len(plain.faces)) == (None, GREY, 3)


def test_texture_coordinates_of_a_quad_follow_its_corners(read, picture):
    picture("t.png", (9, 9, 9))
    (part,) = read(
        ["4 0 1 2 3 8 0 0 0 1 1 1 1 0"],
        face="property list uchar float texcoord\n",
        comments="comment TextureFile t.png\n",
    )
    np.testing.assert_array_equal(part.uv * 4, part.vertices[part.faces][..., [0, 2]])


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
def test_texture_coordinates_of_vertices(read, picture, tmp_path, names):
    picture("my wall.png", (9, 9, 9))
    vertices = [f"{v} {k / 4} {k / 8} 255 0 0" for k, v in enumerate(SQUARE)]
    (part,) = read(
        ["3 0 2 3"],
        vertex=properties("float", *names) + properties("uchar", "red", "green", "blue"),
        vertices=vertices,
        comments="comment TextureFile my%20wall.png\n",
    )
    np.testing.assert_array_equal(part.uv, [[[0, 0], [0.5, 0.25], [0.75, 0.375]]])
    assert part.material.texture.shape == (4, 4, 3)
    assert part.vertex_colors is None, "where a texture shows, the colours are left out"
    assert referenced_by_ply(tmp_path / "scan.ply") == [tmp_path / "my wall.png"]


@pytest.mark.parametrize(
    "names", [("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")]
)
@pytest.mark.parametrize(
    ("kind", "stored"), [("uchar", "255 128 0"), ("float", "1.0 0.5 0.0"), ("ushort", "65535 32896 0")]
)
def test_colours_of_vertices_under_all_names(read, names, kind, stored):
    (part,) = read(["4 0 1 2 3"], vertex=properties(kind, *names), vertices=[f"{v} {stored}" for v in SQUARE])
    np.testing.assert_array_equal(part.vertex_colors, [[255, 128, 0]] * 4)
    assert part.material.color == (255, 255, 255)


def test_colours_of_faces_are_not_blended(read):
    (part,) = read(["4 0 1 2 3 10 20 30", "3 0 1 2 40 50 60"], face=properties("uchar", "red", "green", "blue"))
    np.testing.assert_array_equal(
        part.vertex_colors[part.faces], [[[10, 20, 30]] * 3, [[10, 20, 30]] * 3, [[40, 50, 60]] * 3]
    )


def test_strips_of_triangles(tmp_path):
    """As in the scans of Stanford's repository: one list, strips that end with -1."""
    header = f"ply\nformat ascii 1.0\nelement vertex 6\n{XYZ}element tristrips 1\n{FACE}end_header\n"
    vertices = "0 0 0\n0 0 1\n1 0 0\n1 0 1\n2 0 0\n2 0 1\n"
    (tmp_path / "strip.ply").write_text(header + vertices + "11 0 1 2 3 4 -1 3 5 4 -1 0\n")
    (part,) = read_ply(tmp_path / "strip.ply")
    np.testing.assert_array_equal(part.faces, [[0, 1, 2], [2, 1, 3], [2, 3, 4], [3, 5, 4]])
    normals = trimesh.Trimesh(part.vertices, part.faces, process=False).face_normals
    assert (normals[:3, 1] == normals[0, 1]).all(), "all triangles of a strip face one way"


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_agrees_with_trimesh_on_files_that_trimesh_writes(tmp_path, encoding):
    mesh = trimesh.creation.icosphere(2)
    mesh.visual.vertex_colors = np.random.default_rng(0).integers(0, 256, (len(mesh.vertices), 4), np.uint8)
    mesh.export(tmp_path / "ball.ply", encoding=encoding)
    (part,) = read_ply(tmp_path / "ball.ply")
    np.testing.assert_allclose(part.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(part.faces, mesh.faces)
    np.testing.assert_array_equal(part.vertex_colors, mesh.visual.vertex_colors[:, :3])


@pytest.mark.parametrize(
    ("faces", "settings", "message"),
    [
        ([], {}, "contains 4 points but no triangles"),
        (["3 0 1 9"], {}, "a face uses vertex 9, but there are 4 vertices"),
        (["4 0 1 2 -1"], {}, "a face uses vertex -1, but there are 4 vertices"),
        (["3 0 1 2"], {"comments": "comment TextureFile gone.png\n"}, r"needs gone\.png"),
    ],
)
def test_mistakes_are_one_sentence(read, faces, settings, message):
    with pytest.raises(DeuxError, match=message) as error:
        read(faces, **settings)
    assert "\n" not in str(error.value)
