from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage

from deux.contracts import Robot
from deux.errors import DeuxError
from deux.scenes.free_space import free_space, survey_floor

ROBOT = Robot()


@pytest.fixture
def room(sheet):
    """An open box of sheets, 4 m along x and 3 m along z."""
    floor = sheet([0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3])
    corners = [(0, 0), (4, 0), (4, 3), (0, 3), (0, 0)]
    return floor, *(sheet([a, 0, b], [c, 0, d], [c, 2.5, d], [a, 2.5, b]) for (a, b), (c, d) in pairwise(corners))


def free_at(space, x, z):
    return bool(space.free[space.frame.cell(x, z)])


def free_places(space):
    """World x and z of the centres of all free cells."""
    rows, columns = np.nonzero(space.free)
    frame = space.frame
    return frame.origin_x + (columns + 0.5) * frame.resolution, frame.origin_z + (rows + 0.5) * frame.resolution


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


@pytest.mark.parametrize("x", [1.5, 1.51, 1.52, 1.533, 1.54])
def test_what_stands_on_the_floor_has_no_clearance_wherever_the_grid_lies(mesh_of, room, slab, x):
    """A table of 1 x 1 m, whose top is level and cannot be reached, and a cupboard of 0.5 x 0.5 m."""
    table, cupboard = slab([x, 0, 1], [x + 1, 0.8, 2]), slab([0.2, 0, 0.2], [0.7, 2, 0.7])
    space = free_space(mesh_of(*room, table, cupboard), 0.0, ROBOT)
    blocked = np.count_nonzero(space.clearance <= 0.0) * 0.05**2
    assert blocked == pytest.approx(1.25, abs=0.15)
    for place in ((x + 0.5, 1.5), (0.45, 0.45)):
        assert space.clearance[space.frame.cell(*place)] == 0.0


def test_a_hole_in_the_floor_is_not_free(mesh_of, sheet):
    left = sheet([0, 0, 0], [1.5, 0, 0], [1.5, 0, 3], [0, 0, 3])
    right = sheet([2.0, 0, 0], [4, 0, 0], [4, 0, 3], [2.0, 0, 3])
    bridge = sheet([1.5, 0, 0], [2.0, 0, 0], [2.0, 0, 1], [1.5, 0, 1])
    space = free_space(mesh_of(left, right, bridge), 0.0, ROBOT)
    assert not free_at(space, 1.75, 2.0)
    assert free_at(space, 1.75, 0.5)
    assert free_at(space, 3.0, 2.0)


def test_steps_up_to_the_climb_are_floor_and_a_pit_is_not(mesh_of, slab):
    ground = slab([0, -1.1, 0], [2, 0, 2])
    step, platform = slab([2, -1.1, 0], [3, 0.15, 2]), slab([3, -1.1, 0], [4, 0.3, 2])
    pit = slab([-1, -1.1, 0], [0, -0.5, 2])
    space = free_space(mesh_of(ground, step, platform, pit), 0.0, ROBOT)
    for x, height in ((1.0, 0.0), (2.5, 0.15), (3.5, 0.3)):
        assert space.height_at(x, 1.0) == pytest.approx(height, abs=1e-6)
        assert free_at(space, x, 1.0)
    assert not free_at(space, -0.5, 1.0)
    assert not free_at(space, 0.05, 1.0), "the robot keeps its radius from the drop"
    assert free_at(space, 0.15, 1.0)


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
    with pytest.raises(DeuxError, match=r"no floor to stand on: .* no place is free .* that climbs 0\.2 m"):
        free_space(mesh_of(*room, slab([0, 0, 0], [4, 1, 3])), 0.0, ROBOT)
    with pytest.raises(DeuxError, match=r"no place of the region \[1\.1, 1\.1, 1\.9, 1\.9\] is free"):
        survey_floor(mesh_of(*room, slab([1, 0, 1], [2, 1, 2])), 0.0, ROBOT, region=(1.1, 1.1, 1.9, 1.9))


def test_a_ramp_is_floor_and_the_surface_follows_it(mesh_of, slab, sheet):
    """A ramp of 20 degrees between two levels 0.91 m apart."""
    low, high = slab([0, -1, 0], [2, 0, 2]), slab([4.5, -1, 0], [6, 0.91, 2])
    ramp = sheet([2, 0, 0], [4.5, 0.91, 0], [4.5, 0.91, 2], [2, 0, 2])
    space = free_space(mesh_of(low, ramp, high), 0.0, ROBOT)
    for x in (1.0, 2.6, 3.3, 4.1, 5.5):
        assert free_at(space, x, 1.0)
        assert space.height_at(x, 1.0) == pytest.approx(np.interp(x, [2, 4.5], [0, 0.91]), abs=0.02)
    steep = sheet([2, 0, 0], [2.7, 0.91, 0], [2.7, 0.91, 2], [2, 0, 2])
    assert not free_at(free_space(mesh_of(low, steep, slab([2.7, -1, 0], [6, 0.91, 2])), 0.0, ROBOT), 2.5, 1.0)


@pytest.mark.parametrize(("climb", "joined"), [(0.2, False), (0.35, True)])
def test_split_levels_of_a_room_are_joined_by_the_climb_or_reported(mesh_of, room, slab, climb, joined):
    podium = slab([2.2, 0, 0], [4, 0.3, 3])
    found = survey_floor(mesh_of(*room, podium), 0.0, Robot(max_climb=climb))
    assert free_at(found.space, 1.0, 1.5)
    assert free_at(found.space, 3.5, 1.5) is joined
    assert found.space.area == pytest.approx(10.64 if joined else 2.0 * 2.8, rel=0.03)
    if not joined:
        (level,) = found.unreached
        assert (level.rise, level.area) == (pytest.approx(0.3, abs=1e-6), pytest.approx(1.6 * 2.8, rel=0.1))
    assert joined == (not found.unreached)


def test_a_flight_of_stairs_belongs_to_each_floor_up_to_half_the_way(mesh_of, two_storeys):
    mesh = mesh_of(*two_storeys())
    lower = survey_floor(mesh, 0.0, ROBOT, other_floors=[2.9]).space
    upper = survey_floor(mesh, 2.9, ROBOT, other_floors=[0.0]).space
    for k in range(17):
        x, height = 0.5 + 0.25 * (k + 0.5), 2.9 / 18 * (k + 1)
        for space, there in ((lower, height <= 1.45), (upper, height >= 1.45)):
            if abs(height - 1.45) > 0.1:  # the robot's radius at either end
                assert free_at(space, x, 5.2) == there, f"step {k + 1} at {height:.2f} m"
            if free_at(space, x, 5.2):
                assert space.height_at(x, 5.2) == pytest.approx(height, abs=1e-5)
    assert lower.area == pytest.approx(upper.area, rel=0.2)
    assert np.nanmax(lower.heights) <= 1.45 <= np.nanmin(upper.heights)


def test_steps_that_are_too_high_join_nothing(mesh_of, two_storeys):
    lower = survey_floor(mesh_of(*two_storeys(steps=12)), 0.0, ROBOT, other_floors=[2.9]).space
    assert np.nanmax(lower.heights) == 0.0


def test_the_floor_under_a_bridge_stays_floor(mesh_of, room, slab):
    space = free_space(mesh_of(*room, slab([1.5, 1.7, 0], [2.5, 1.8, 3])), 0.0, ROBOT)
    assert space.area == pytest.approx(3.8 * 2.8, rel=0.02)
    assert np.nanmax(space.heights) == 0.0


def test_heights_are_known_where_the_floor_is_free(mesh_of, two_storeys):
    space = survey_floor(mesh_of(*two_storeys()), 0.0, ROBOT, other_floors=[2.9]).space
    assert space.heights.dtype == np.float32
    np.testing.assert_array_equal(np.isfinite(space.heights), space.free)


@pytest.mark.parametrize("reach", [2.0, 8.0])
def test_the_robot_stays_in_a_house_whose_door_opens_to_a_garden(mesh_of, house, slab, reach):
    garden = slab([-reach, -0.5, -reach], [8 + reach, -0.05, 6 + reach])
    mesh = mesh_of(*house(door=True), garden)
    indoors = free_space(mesh, 0.0, ROBOT)
    x, z = free_places(indoors)
    assert 0.2 < x.min() < x.max() < 7.8
    assert -0.6 < z.min() < z.max() < 5.8
    assert indoors.area == pytest.approx(7.4 * 5.4, rel=0.04)
    started = survey_floor(mesh, 0.0, ROBOT, start=(4.0, 3.0)).space
    np.testing.assert_array_equal(started.free, indoors.free)
    outdoors = survey_floor(mesh, 0.0, ROBOT, start=(-1.0, -1.0)).space
    assert free_at(outdoors, -1.0, 3.0)
    assert free_at(outdoors, 4.0, 3.0), "the door is open"
    assert outdoors.area > 1.5 * indoors.area
    assert outdoors.height_at(-1.0, 3.0) == pytest.approx(-0.05, abs=1e-6)


def test_a_region_bounds_the_robots_centre_and_is_no_wall(mesh_of, room):
    mesh = mesh_of(*room)
    whole, part = free_space(mesh, 0.0, ROBOT), survey_floor(mesh, 0.0, ROBOT, region=(1.0, -5.0, 2.0, 1.5)).space
    x, z = free_places(part)
    assert (x.min(), x.max(), z.max()) == (pytest.approx(1.025), pytest.approx(1.975), pytest.approx(1.475))
    assert z.min() == pytest.approx(free_places(whole)[1].min())
    with pytest.raises(DeuxError, match=r"the region \[10.0, 0.0, 11.0, 1.0\] is not in the scene"):
        survey_floor(mesh, 0.0, ROBOT, region=(10.0, 0.0, 11.0, 1.0))


def test_a_start_chooses_the_part_of_the_floor(mesh_of, room, sheet):
    wall = sheet([2.6, 0, 0], [2.6, 0, 3], [2.6, 2.5, 3], [2.6, 2.5, 0])
    mesh = mesh_of(*room, wall)
    smaller = survey_floor(mesh, 0.0, ROBOT, start=(3.5, 1.5)).space
    assert free_at(smaller, 3.0, 1.0)
    assert not free_at(smaller, 1.0, 1.5)
    with pytest.raises(DeuxError, match=r"x=2.62, z=1.50 is not on free floor: the nearest free point is x=2.7"):
        survey_floor(mesh, 0.0, ROBOT, start=(2.62, 1.5))


def test_a_scene_that_is_too_large_for_a_map_is_reported(mesh_of, slab):
    with pytest.raises(DeuxError, match=r"1000 x 1000 m is too large for a map: limit it by scenes.region"):
        free_space(mesh_of(slab([0, -1, 0], [1000, 0, 1000])), 0.0, ROBOT)


def test_agrees_with_habitats_navigation_mesh(shared_data, small_house):
    """Intersection over union at the points that Habitat-Sim sampled, which are corners of cells of 5 cm.

    Its heights are multiples of 20 cm: it climbs things up to 40 cm, and lamps at 1.8 m are in its way.
    """
    with np.load(shared_data("habitat") / "topdown_5cm.npz") as habitat:
        islands, largest, (x, z) = habitat["islands"], habitat["largest_island"], habitat["origin_xz"]
    theirs = islands == largest
    # A grid begins at the scene's lowest corner: a speck half a cell beyond it puts its centres on these points.
    speck = np.full((3, 3), [x - 0.025, 1.0, z - 0.025], np.float32)
    mesh = replace(
        small_house.mesh,
        vertices=np.concatenate([small_house.mesh.vertices, speck]),
        faces=np.concatenate([small_house.mesh.faces, len(small_house.mesh.vertices) + np.int32([[0, 1, 2]])]),
    )
    space = free_space(mesh, small_house.floor_height, ROBOT)
    ours = space.free[: theirs.shape[0], : theirs.shape[1]]
    assert space.frame.centre(0, 0) == pytest.approx((x, z), abs=1e-5)
    assert (ours & theirs).sum() / (ours | theirs).sum() > 0.955
    assert space.area == pytest.approx(137.28, rel=0.005), "the area of Habitat-Sim's largest island"
    # Away from its border by more than a cell, the mesh differs only by what its coarse heights swallow.
    inner = ndimage.binary_erosion(theirs, iterations=2) | ~ndimage.binary_dilation(theirs, iterations=2)
    assert (ours == theirs)[inner].mean() > 0.98


def test_a_scan_with_holes_has_one_connected_floor(lounge):
    space = free_space(lounge.mesh, lounge.floor_height, ROBOT)
    assert ndimage.label(space.free)[1] == 1
    assert 15.0 < space.area < 30.0
    assert (space.clearance[space.free] > ROBOT.radius).all()
