import numpy as np
import pytest
import trimesh

from deux.errors import DeuxError


@pytest.fixture
def room(slab):
    """A closed 6 x 4 m room of thick walls, floor at 0.5, ceiling at 3."""
    shell = slab([0, 0.3, 0], [6, 3.2, 4])
    inside = slab([0.2, 0.5, 0.2], [5.8, 3.0, 3.8])
    inside.invert()
    return shell, inside


def test_floor_of_a_room_is_the_floor_not_the_slab_or_the_ceiling(mesh_of, room):
    assert floor_height(mesh_of(*room)) == pytest.approx(0.5, abs=1e-3)


def test_the_direction_of_faces_does_not_matter(mesh_of, room):
    turned = [part.copy() for part in room]
    for part in turned:
        part.invert()
    assert floor_height(mesh_of(*turned)) == pytest.approx(0.5, abs=1e-3)


def test_stray_geometry_below_the_floor_is_ignored(mesh_of, room, slab):
    pit = slab([10, -3, 10], [10.5, -2.5, 10.5])
    stairs = [slab([8, -0.2 * k - 0.1, k], [9, -0.2 * k, k + 0.3]) for k in range(8)]
    assert floor_height(mesh_of(*room, pit, *stairs)) == pytest.approx(0.5, abs=1e-3)


def test_furniture_over_most_of_the_floor_does_not_become_the_floor(mesh_of, room, slab):
    beds = [slab([x, 0.5, 0.3], [x + 1.0, 1.0, 3.0]) for x in (0.4, 1.8, 3.2, 4.6)]
    assert floor_height(mesh_of(*room, *beds)) == pytest.approx(0.5, abs=1e-3)


def test_the_lower_of_two_storeys_is_the_floor(mesh_of, slab):
    storeys = [slab([0, y - 0.2, 0], [6, y, 5]) for y in (0.0, 3.0, 6.0)]
    assert floor_height(mesh_of(*storeys)) == pytest.approx(0.0, abs=1e-3)


def test_a_rough_scanned_floor_lies_at_its_middle(mesh_of):
    rng = np.random.default_rng(3)
    x, z = np.meshgrid(np.arange(0, 5, 0.05), np.arange(0, 5, 0.05))
    rough = rng.normal(0.7, 0.01, x.size)
    points = np.stack([x.ravel(), rough, z.ravel()], axis=-1)
    width = x.shape[1]
    corner = (np.arange(x.shape[0] - 1)[:, None] * width + np.arange(width - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + width, corner + 1], axis=-1),
            np.stack([corner + 1, corner + width, corner + width + 1], axis=-1),
        ]
    )
    assert floor_height(mesh_of(trimesh.Trimesh(points, faces, process=False))) == pytest.approx(0.7, abs=5e-3)


def test_walls_alone_are_no_floor(mesh_of, sheet):
    wall = sheet([0, 0, 0], [5, 0, 0], [5, 3, 0], [0, 3, 0])
    with pytest.raises(DeuxError, match="no floor to stand on"):
        floor_height(mesh_of(wall))


def test_a_crawl_space_is_no_floor(mesh_of, sheet):
    level = [sheet([0, y, 0], [5, y, 0], [5, y, 5], [0, y, 5]) for y in (0.0, 0.6)]
    assert floor_height(mesh_of(*level)) == pytest.approx(0.6, abs=1e-3)


def test_real_scenes_stand_at_zero(small_house, lounge):
    assert small_house.floor_height == pytest.approx(0.0, abs=0.005)
    assert lounge.floor_height == pytest.approx(0.0, abs=0.015)
