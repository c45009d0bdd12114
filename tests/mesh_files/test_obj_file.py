from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from deux.errors import DeuxError
from deux.mesh_files.mesh_parts import GREY, MeshPart
from deux.mesh_files.obj_file import read_obj, referenced_by_obj

SQUARE = "v 0 0 0\nv 0 0 4\nv 4 0 4\nv 4 0 0\nvt 0 0\nvt 0 1\nvt 1 1\nvt 1 0\n"


@pytest.fixture
def read(tmp_path):
    """A function that writes an OBJ file, and others by name, and reads it."""

    def write_and_read(text: str, **others: str) -> list[MeshPart]:
        for name, content in others.items():
            (tmp_path / f"{name}.mtl").write_text(content)
        (tmp_path / "scene.obj").write_bytes(text.encode())
        return read_obj(tmp_path / "scene.obj")

    return write_and_read


@pytest.fixture
def picture(tmp_path):
    """Write a picture of noise under a name in the folder of the scene; returns its pixels."""

    def write(name: str) -> np.ndarray:
        pixels = np.random.default_rng(len(name)).integers(0, 256, (4, 8, 3), np.uint8)
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels).save(tmp_path / name)
        return pixels

    return write


def area(parts: list[MeshPart]) -> float:
    return sum(trimesh.Trimesh(part.vertices, part.faces, process=False).area for part in parts)


@pytest.mark.parametrize(
    "face",
    [
        "f 1 2 3 4",
        "f 1/1 2/2 3/3 4/4",
        "f 1//1 2//1 3//1 4//1",
        "f 1/1/1 2/2/1 3/3/1 4/4/1",
        "f -4 -3 -2 -1",
        "f -4/-4 -3/-3 -2/-2 -1/-1",
        "f 1 2 \\\n3 4",
        "f 1 2 \\\r\n3 4",
        "  f\t1 2\t3 4  # a floor",
        "fo 1 2 3 4",
    ],
)
def test_every_way_to_write_a_face(read, face):
    (part,) = read(SQUARE + "vn 0 1 0\n" + face + "\n")
    assert area([part]) == 16.0
    assert part.material.color == GREY


def test_relative_indices_count_from_where_they_stand(read):
    first = "v 0 0 0\nv 0 0 1\nv 1 0 1\nf -3 -2 -1\n"
    second = "v 5 0 0\nv 5 0 2\nv 7 0 2\nf -3 -2 -1\nf 1 2 -1\n"
    (part,) = read(first + second)
    np.testing.assert_array_equal(part.faces, [[0, 1, 2], [3, 4, 5], [0, 1, 5]])


def test_concave_polygons_are_cut_where_they_are(read):
    corners = [(2, 4), (2, 2), (4, 2), (4, 0), (0, 0), (0, 4)]
    parts = read("".join(f"v {x} 0 {z}\n" for x, z in corners) + "f 1 2 3 4 5 6\n")
    assert area(parts) == pytest.approx(12.0)


@pytest.mark.parametrize("line", ["mtllib r.mtl g.mtl", "mtllib r.mtl\nmtllib g.mtl", 'MTLLIB "r.mtl"\nmtllib g.mtl'])
def test_several_material_libraries(read, line):
    faces = "usemtl red one\nf 1/1 2/2 3/3\nusemtl green\nf 1/1 3/3 4/4\n"
    parts = read(f"{line}\n" + SQUARE + faces, r="newmtl red one\nKd 1 0 0\n", g="newmtl green\nKd 0 0.5 0\n")
    assert {part.material.name: part.material.color for part in parts} == {"red one": (255, 0, 0), "green": (0, 128, 0)}


def test_a_library_with_blanks_in_its_name(read):
    (part,) = read("mtllib my flat.mtl\n" + SQUARE + "usemtl m\nf 1 2 3\n", **{"my flat": "newmtl m\nKd 0 0 1\n"})
    assert part.material.color == (0, 0, 255)


@pytest.mark.parametrize("names", [("wall#1", "wall#2"), ("Material #1", "Material #2"), ("#f00", "#0f0")])
def test_names_of_materials_may_hold_a_hash(read, names):
    first, second = names
    library = f"# two\nnewmtl {first} \nKd 1 0 0 # red\nnewmtl {second}\nKd 0 1 0\n"
    faces = f"usemtl {first}\nf 1/1 2/2 3/3 # half\nusemtl {second}\nf 1/1 3/3 4/4\n"
    parts = read("mtllib m.mtl # of this file\n" + SQUARE + faces, m=library)
    assert {part.material.name: part.material.color for part in parts} == {first: (255, 0, 0), second: (0, 255, 0)}


@pytest.mark.parametrize("statement", ["map_Kd", "map_Kd ", "Kd"])
def test_an_empty_statement_of_a_library_changes_nothing(read, statement):
    (part,) = read("mtllib m.mtl\n" + SQUARE + "usemtl m\nf 1 2 3\n", m=f"newmtl m\nKd 1 0 0\n{statement}\n")
    assert (part.material.color, part.material.texture) == ((255, 0, 0), None)


@pytest.mark.parametrize(
    ("value", "name", "uv"),
    [
        ("wall.png", "wall.png", [2, 3]),
        ("old wall.png", "old wall.png", [2, 3]),
        ("-s 4 2 1 wall.png", "wall.png", [8, 6]),
        ("-s 4 wall.png", "wall.png", [8, 3]),
        ("-o 0.5 -s 2 2 old wall.png", "old wall.png", [4.5, 6]),
        ("-clamp on -blendu off -mm 0 1 -bm 1.0 -o 0.5 0.25 wall.png", "wall.png", [2.5, 3.25]),
        ("textures\\deep\\wall.png", "textures/deep/wall.png", [2, 3]),
        ("C:\\Users\\me\\wall.png", "wall.png", [2, 3]),
        ("old%20wall.png", "old wall.png", [2, 3]),
        ("-s 2 2 1", "1", None),
    ],
)
def test_textures_and_their_options(read, picture, tmp_path, value, name, uv):
    if uv is None:  # a name that looks like a number
        picture("1.png")
        (tmp_path / "1.png").rename(tmp_path / "1")
        uv, pixels = [4, 6], np.asarray(Image.open(tmp_path / "1"))
    else:
        pixels = picture(name)
    corners = "v 0 0 0\nv 0 0 4\nv 4 0 4\nvt 2 3\nvt 0 0\nvt 0 0\n"
    text = "mtllib m.mtl\n" + corners + "usemtl m\nf 1/1 2/2 3/3\n"
    (part,) = read(text, m=f"newmtl m\nKd 0 0 0\nmap_Kd {value}\n")
    np.testing.assert_array_equal(part.material.texture, pixels)
    np.testing.assert_allclose(part.uv[0, 0], uv)
    assert part.material.color == (255, 255, 255), "viewers show the texture alone"
    assert referenced_by_obj(tmp_path / "scene.obj") == [tmp_path / "m.mtl", tmp_path / name]


def test_faces_without_coordinates_show_the_base_colour(read, picture):
    picture("wall.png")
    text = "mtllib m.mtl\n" + SQUARE + "usemtl m\nf 1/1 2/2 3/3\nf 1 3 4\n"
    textured, plain = read(text, m="newmtl m\nKd 0.2 0.4 0.6\nmap_Kd wall.png\n")
    assert (textured.material.color, textured.uv.shape) == ((255, 255, 255), (1, 3, 2))
    assert (plain.material.color, plain.material.texture, plain.uv) == ((51, 102, 153), None, None)
    assert textured.vertices is plain.vertices


@pytest.mark.parametrize("scale", [1, 255])
def test_colours_after_the_positions(read, scale):
    (part,) = read(f"v 0 0 0 {scale} 0 0\nv 0 0 1 0 {scale} 0\nv 1 0 1\nf 1 2 3\n")
    np.testing.assert_array_equal(part.vertex_colors, [[255, 0, 0], [0, 255, 0], [255, 255, 255]])
    assert part.material.color == (255, 255, 255)


@pytest.mark.parametrize("first", ["mtllib m.mtl\n", ""])
def test_the_mark_before_a_text_of_utf_8_hides_no_line(read, first):
    """Editors put it there: the first vertex, the library or its first material would be lost without a word."""
    (part,) = read("\ufeff" + first + SQUARE + "usemtl red\nf 1 2 3 4\n", m="\ufeffnewmtl red\nKd 1 0 0\n")
    assert area([part]) == 16.0
    assert part.material.color == ((255, 0, 0) if first else GREY)


def test_groups_lines_and_points_change_nothing(read):
    text = SQUARE + "o house\ng walls\ns off\nl 1 2\np 1\nf 1/1 2/2 3/3\ng floor\nf 1/1 3/3 4/4\n"
    assert area(read(text)) == 16.0


def test_a_material_that_no_library_describes_is_reported(read, caplog):
    (part,) = read("mtllib m.mtl\n" + SQUARE + "usemtl wood\nf 1 2 3\n", m="newmtl oak\nKd 1 1 1\n")
    assert part.material.color == GREY
    assert "contains wood" in caplog.text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mtllib nowhere.mtl\n" + SQUARE + "f 1 2 3\n", r"needs nowhere\.mtl"),
        ("mtllib m.mtl\n" + SQUARE + "usemtl m\nf 1/1 2/2 3/3\n", r"m\.mtl needs nowhere\.png"),
        (SQUARE + "f 1 2 9\n", r"'1 2 9' refers to a vertex that does not exist, there are 4"),
        (SQUARE + "f 1 2 3\nf 1/1 2/2 3/7\n", "'1/1 2/2 3/7' refers to a texture coordinate that does not exist"),
        (SQUARE + "f 1 2 -5\n", "that does not exist"),
        (SQUARE + f"f {2**64 + 1} 2 3\n", "18446744073709551617"),  # 1, if 64 bits were all that is looked at
        (SQUARE + "f 0 1 2\n", "a face has the corners '0 1 2'"),
        (SQUARE + "f a b c\n", "a face has the corners 'a b c'"),
        ("v 0 0\nf 1 1 1\n", "a vertex has the numbers '0 0'"),
        ("v 0 0 x\nf 1 1 1\n", "is damaged or not a .obj file"),
        (SQUARE + "surf 0 1 0 1 1 2 3\n", "its surf statements are not supported"),
    ],
)
def test_mistakes_are_one_sentence(read, text, message):
    with pytest.raises(DeuxError, match=message) as error:
        read(text, m="newmtl m\nmap_Kd nowhere.png\n")
    assert "\n" not in str(error.value)


def test_agrees_with_trimesh_on_a_file_that_trimesh_writes(tmp_path: Path):
    rng = np.random.default_rng(1)
    mesh = trimesh.creation.icosphere(2)
    uv = rng.uniform(0, 1, (len(mesh.vertices), 2))
    image = Image.fromarray(rng.integers(0, 256, (8, 8, 3), np.uint8))
    material = trimesh.visual.material.SimpleMaterial(image=image)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    mesh.export(tmp_path / "ball.obj")
    (part,) = read_obj(tmp_path / "ball.obj")
    np.testing.assert_allclose(part.vertices[part.faces], mesh.triangles, atol=1e-7)
    np.testing.assert_allclose(part.uv, uv[mesh.faces], atol=1e-7)
    np.testing.assert_array_equal(part.material.texture, np.asarray(image))
