from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage

from deux.contracts import Robot
from deux.errors import DeuxError
from deux.scenes.free_space import free_space

ROBOT = Robot()


@pytest.fixture
def room(sheet):
    """An open box of sheets, 4 m along x and 3 m along z."""
    floor = sheet([0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3])
    corners = [(0, 0), (4, 0), (4, 3), (0, 3), (0, 0)]
    return floor, *(sheet([a, 0, b], [c, 0, d], [c, 2.5, d], [a, 2.5, b]) for (a, b), (c, d) in pairwise(corners))


def free_at(space, x, z):
    return bool(space.free[space.frame.cell(x, z)])


def test_an_empty_room_loses_the_radius_at_its_walls(mesh_of, room):
    space = free_space(mesh_of(*room), 0.0, ROBOT)
    assert space.frame.shape == (60, 80)
    assert space.area == pytest.approx(3.8 * 2.8, rel=0.02)


def test_clearance_is_the_distance_to_the_nearest_wall(mesh_of, room):
    space = free_space(mesh_of(*room), 0.0, ROBOT)
    rows, columns = np.nonzero(space.free)
    x, z = (columns + 0.5) * 0.05, (rows + 0.5) * 0.05
    expected = np.minimum.reduce([x, 4 - x, z, 3 - z])
    np.testing.assert_allclose(space.clearance[rows, columns], expected, atol=0.02)


def test_an_upright_sheet_parts_the_room(mesh_of, room, sheet):
    x = 2.6123  # between the rays
    wall = sheet([x, 0, 0], [x, 0, 3], [x, 2.5, 3], [x, 2.5, 0])
    space = free_space(mesh_of(*room, wall), 0.0, ROBOT)
    assert free_at(space, 1.0, 1.5)
    assert not free_at(space, x, 1.5)
    assert not free_at(space, 3.5, 1.5), "the smaller side is not connected"
    assert space.clearance[space.frame.cell(x - 0.5, 1.5)] == pytest.approx(0.5, abs=0.04)


def test_a_slanted_sheet_blocks_along_its_whole_foot(mesh_of, room, sheet):
    wall = sheet([1, 0.5, 0], [3, 0.5, 3], [3, 0.9, 3], [1, 0.9, 0])
    space = free_space(mesh_of(*room, wall), 0.0, ROBOT)
    along = np.linspace(0.0, 1.0, 50)
    assert not any(free_at(space, 1 + 2 * t, 3 * t) for t in along)
    assert len(np.unique(ndimage.label(space.free)[0])) == 2


@pytest.mark.parametrize(
    ("low", "high", "free"),
    [
        pytest.param(0.0, 0.1, True, id="rug"),
        pytest.param(0.0, 0.4, False, id="box"),
        pytest.param(0.70, 0.75, False, id="table"),
        pytest.param(1.8, 1.9, True, id="lamp above the robot"),
        pytest.param(-1.0, 3.0, False, id="pillar"),
    ],
)
def test_what_is_in_the_way_depends_on_its_height(mesh_of, room, slab, low, high, free):
    thing = slab([1.6, low, 1.1], [2.4, high, 1.9])
    space = free_space(mesh_of(*room, thing), 0.0, ROBOT)
    assert free_at(space, 2.0, 1.5) is free
    assert free_at(space, 0.5, 0.5)
    # Its edge too blocks as far as the robot's radius, and no farther.
    assert free_at(space, 1.55, 1.5) is free
    assert free_at(space, 1.45, 1.5)


def test_a_hole_in_the_floor_is_not_free(mesh_of, sheet):
    left = sheet([0, 0, 0], [1.5, 0, 0], [1.5, 0, 3], [0, 0, 3])
    right = sheet([2.0, 0, 0], [4, 0, 0], [4, 0, 3], [2.0, 0, 3])
    bridge = sheet([1.5, 0, 0], [2.0, 0, 0], [2.0, 0, 1], [1.5, 0, 1])
    space = free_space(mesh_of(left, right, bridge), 0.0, ROBOT)
    assert not free_at(space, 1.75, 2.0)
    assert free_at(space, 1.75, 0.5)
    assert free_at(space, 3.0, 2.0)


def test_a_step_up_to_the_climb_is_floor_and_a_pit_is_not(mesh_of, slab):
    ground = slab([0, -1.1, 0], [2, 0, 2])
    step, platform = slab([2, -1.1, 0], [3, 0.15, 2]), slab([3, -1.1, 0], [4, 0.3, 2])
    pit = slab([-1, -1.1, 0], [0, -0.5, 2])
    space = free_space(mesh_of(ground, step, platform, pit), 0.0, ROBOT)
    assert free_at(space, 2.5, 1.0)
    assert not free_at(space, 3.5, 1.0)
    assert not free_at(space, -0.5, 1.0)


def test_a_larger_robot_has_less_room(mesh_of, room, slab):
    gap = slab([1.9, 0, 0], [2.1, 2, 1.2]), slab([1.9, 0, 1.6], [2.1, 2, 3])
    mesh = mesh_of(*room, *gap)
    assert free_at(free_space(mesh, 0.0, ROBOT), 2.0, 1.4)
    assert free_space(mesh, 0.0, Robot(radius=0.25)).area < 0.5 * free_space(mesh, 0.0, ROBOT).area


def test_resolution_and_place_do_not_change_the_area(mesh_of, room):
    moved = [part.copy().apply_translation([-7.123, 1.4, 31.77]) for part in room]
    coarse, fine = (free_space(mesh_of(*moved), 1.4, ROBOT, resolution=r) for r in (0.1, 0.02))
    assert coarse.area == pytest.approx(fine.area, rel=0.06)
    assert free_at(fine, 2 - 7.123, 1.5 + 31.77)


def test_no_room_at_all_is_an_error(mesh_of, room, slab):
    with pytest.raises(DeuxError, match="no floor to stand on"):
        free_space(mesh_of(*room, slab([0, 0, 0], [4, 1, 3])), 0.0, ROBOT)


def inside_triangles(triangles, x, z):
    """Which points (x, z) lie in any of the triangles, K x 3 x 2, seen from above."""
    points = np.stack([x, z], axis=-1)
    result = np.zeros(len(points), bool)
    for corners in triangles:
        edges = np.roll(corners, -1, axis=0) - corners
        offset = points[:, None] - corners
        side = edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0]
        result |= (side >= 0).all(axis=1) | (side <= 0).all(axis=1)
    return result


def test_agrees_with_habitats_navigation_mesh(shared_data, small_house, house_caster):
    """Its rounding differs (20 cm in height: things up to 40 cm are climbed, lamps at 1.8 m are in the way)."""
    space = free_space(small_house.mesh, small_house.floor_height, ROBOT, caster=house_caster)
    with np.load(shared_data("habitat") / "topdown_5cm.npz") as habitat:
        triangles = habitat["navmesh_vertices"][habitat["navmesh_triangles"]]
    frame = space.frame
    rows, columns = np.mgrid[: frame.rows, : frame.columns]
    x = frame.origin_x + (columns.ravel() + 0.5) * frame.resolution
    z = frame.origin_z + (rows.ravel() + 0.5) * frame.resolution
    on_floor = triangles[..., 1].max(axis=1) < 0.62
    navigable = inside_triangles(triangles[on_floor][..., [0, 2]], x, z).reshape(frame.shape)
    regions, _ = ndimage.label(navigable)
    navigable = regions == np.bincount(regions.ravel())[1:].argmax() + 1

    assert space.area == pytest.approx(137.28, rel=0.01)
    assert (space.free == navigable).mean() > 0.965
    # Away from its border by more than a cell, the mesh differs only by what its coarse heights swallow.
    inner = ndimage.binary_erosion(navigable, iterations=2) | ~ndimage.binary_dilation(navigable, iterations=2)
    assert (space.free == navigable)[inner].mean() > 0.98


def test_a_scan_with_holes_has_one_connected_floor(lounge):
    space = free_space(lounge.mesh, lounge.floor_height, ROBOT)
    assert ndimage.label(space.free)[1] == 1
    assert 15.0 < space.area < 30.0
    assert (space.clearance[space.free] > ROBOT.radius).all()
