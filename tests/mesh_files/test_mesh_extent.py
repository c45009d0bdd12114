from pathlib import Path

import numpy as np
import pytest
import trimesh

from deux.errors import DeuxError
from deux.mesh_files.mesh_extent import check_extent, near_faces, unit_advice

PATH = Path("house.ply")


def bounds(x: float, y: float, z: float) -> np.ndarray:
    return np.array([[0.0, 0.0, 0.0], [x, y, z]])


@pytest.mark.parametrize(
    ("size", "scale", "advice"),
    [
        ((500, 260, 400), 1.0, "in centimetres, set scenes.scale=0.01 "),
        ((5000, 2600, 4000), 1.0, "in millimetres, set scenes.scale=0.001 "),
        ((500, 98, 400), 1.0, "in inches, set scenes.scale=0.0254 "),
        ((9000, 0, 9000), 1.0, "is it in metres"),
    ],
)
def test_the_unit_of_a_building_in_another_unit_is_named(size, scale, advice):
    with pytest.raises(DeuxError, match=advice) as error:
        check_extent(PATH, bounds(*size) * scale, scale)
    assert str(error.value).startswith("house.ply is ")


@pytest.mark.parametrize(("size", "scale"), [((6, 2.6, 8), 0.01), ((19, 3, 11), 0.001), ((6, 2.6, 8), 100.0)])
def test_metres_are_named_where_another_unit_was_assumed(size, scale):
    assert "it seems to be in metres, set scenes.scale=1 " in unit_advice(bounds(*size) * scale, scale)


def test_a_large_building_in_metres_passes():
    check_extent(PATH, bounds(200, 40, 240), 1.0)


def test_stray_triangles_are_those_far_from_the_most_area():
    room = trimesh.creation.box((8, 3, 6)).subdivide()
    stray = np.array([[900, 0, 0], [901, 0, 0], [900, 0, 1], [0, 0, -400], [1, 0, -400], [0, 0, -401]], float)
    vertices = np.concatenate([room.vertices, stray])
    first, last = len(room.vertices) + np.arange(3), len(room.vertices) + np.arange(3, 6)
    faces = np.concatenate([[first], room.faces, [last]])
    near = near_faces(vertices, faces)
    np.testing.assert_array_equal(np.flatnonzero(~near), [0, len(faces) - 1])
    assert near_faces(np.asarray(room.vertices), room.faces).all()


def test_two_buildings_of_one_size_are_both_kept():
    one = trimesh.creation.box((8, 3, 6))
    two = trimesh.util.concatenate([one, one.copy().apply_translation((100, 0, 0))])
    assert near_faces(np.asarray(two.vertices), two.faces).all()


def test_a_street_of_houses_is_one_scene():
    houses = [trimesh.creation.box((8, 3, 6)).apply_translation((30 * k, 0, 0)) for k in range(7)]
    street = trimesh.util.concatenate(houses)
    assert near_faces(np.asarray(street.vertices), street.faces).all()
