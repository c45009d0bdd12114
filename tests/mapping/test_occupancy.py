import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from deux.contracts import Action, Robot
from deux.geometry.camera import Camera
from deux.mapping.occupancy import EXACT, FREE, OCCUPIED, UNKNOWN, DepthTolerance, OccupancyMap
from deux.mapping.planning import distance_field
from deux.mapping.traversable import process_map
from deux.testing.box_world import Box, BoxWorld

TABLE = Box(3.0, 1.0, 4.0, 2.0, 0.7)
DOORSTEP = Box(1.0, 3.0, 2.0, 3.5, 0.15)


def look_around(world, occupancy, change=lambda depth: depth):
    for degrees in range(0, 360, 10):
        world.reset(world.pose[0, 3], world.pose[2, 3], np.radians(degrees))
        occupancy.update(change(world.observe().depth), world.pose)


def state(occupancy, x, z):
    rows, columns = occupancy.frame.cells(np.asarray(x), np.asarray(z))
    return occupancy.cells[rows, columns]


@pytest.fixture(scope="module", params=[64, 128, 400])
def mapped(request):
    """A room with a table and a doorstep, and its map after the robot looked all round from the middle."""
    world = BoxWorld(5.0, 4.0, (TABLE, DOORSTEP), Camera(request.param, request.param))
    world.reset(2.0, 2.0, 0.0)
    occupancy = OccupancyMap(world.camera, world.robot, max_range=4.0)
    look_around(world, occupancy)
    return world, occupancy


def test_a_room_seen_from_its_middle_is_mapped_as_it_is(mapped):
    world, occupancy = mapped
    x, z = np.meshgrid(np.arange(-1.0, 6.0, 0.05) + 0.025, np.arange(-1.0, 5.0, 0.05) + 0.025)
    cells = state(occupancy, x, z)
    inside_room = (x > 0) & (x < world.width) & (z > 0) & (z < world.length)
    clearance = world.clearance(x, z)
    # Cells of the floor, but for those that a wall or the table's edge shares and those in the table's shadow.
    floor = inside_room & (clearance > 0.05) & ~((x > 2.95) & (z < 2.05))
    assert (cells[floor] == FREE).mean() > 0.995
    outside = ~inside_room & (clearance < -0.05)
    assert (cells[outside] == FREE).mean() < 0.01
    along_wall = np.arange(1.0, 4.0, 0.05) + 0.025
    # The wall lies on the border between two rows of cells: its points may fall into either.
    rows = [state(occupancy, along_wall, np.full(along_wall.shape, world.length + d)) for d in (0.02, -0.02)]
    assert ((rows[0] == OCCUPIED) | (rows[1] == OCCUPIED)).mean() > 0.95


def test_a_table_is_an_obstacle_and_a_step_that_the_robot_climbs_is_floor(mapped):
    _, occupancy = mapped
    assert state(occupancy, 3.2, 1.5) == OCCUPIED
    assert state(occupancy, 1.5, 3.2) == FREE


@pytest.mark.parametrize("size", [64, 400])
def test_what_was_not_seen_is_unknown_and_what_the_robot_stands_on_is_free(size):
    world = BoxWorld(5.0, 4.0, camera=Camera(size, size))
    world.reset(2.0, 2.0, 0.0)
    occupancy = OccupancyMap(world.camera, world.robot)
    occupancy.update(world.observe().depth, world.pose)
    assert state(occupancy, 2.0, 3.0) == UNKNOWN, "behind the robot"
    assert state(occupancy, 2.0, 2.0) == FREE
    assert state(occupancy, 2.0, 1.0) == FREE, "ahead, below the camera's view, passed over"


def test_nothing_beyond_the_range_is_entered():
    world = BoxWorld(20.0, 20.0, camera=Camera(64, 64, max_depth=30.0))
    occupancy = OccupancyMap(world.camera, world.robot, max_range=2.0)
    look_around(world, occupancy)
    rows, columns = np.nonzero(occupancy.cells)
    x, z = occupancy.frame.centre(rows.min(), columns.min())
    assert min(x, z) > 10.0 - 2.1
    assert (occupancy.cells != OCCUPIED).all()


def test_later_frames_correct_a_wrong_one():
    world = BoxWorld(6.0, 6.0, camera=Camera(64, 64))
    world.reset(3.0, 4.0, 0.0)
    occupancy = OccupancyMap(world.camera, world.robot)
    depth = world.observe().depth
    ghost = np.minimum(depth, 1.5)
    occupancy.update(ghost, world.pose)
    assert state(occupancy, 3.0, 2.5 - 1e-3) == OCCUPIED
    for _ in range(5):
        occupancy.update(depth, world.pose)
    assert state(occupancy, 3.0, 2.5 - 1e-3) == FREE


def test_noisy_depth_leaves_the_floor_free_and_the_walls_closed():
    world = BoxWorld(5.0, 4.0, camera=Camera(64, 64))
    rng = np.random.default_rng(0)
    occupancy = OccupancyMap(world.camera, world.robot)

    def noisy(depth):
        coarse = np.kron(rng.normal(size=(8, 8)), np.ones((8, 8)))
        return (depth * (1.0 + 0.05 * coarse)).astype(np.float32)

    for _ in range(2):
        look_around(world, occupancy, noisy)
    x, z = np.meshgrid(np.arange(0.5, 4.5, 0.05), np.arange(0.5, 3.5, 0.05))
    assert (state(occupancy, x, z) == FREE).mean() > 0.98
    frame = occupancy.frame
    here = frame.cell(2.5, 2.0)
    reached = np.isfinite(distance_field(process_map(occupancy.cells, 2.0, [here]), here))
    rows, columns = np.nonzero(reached)
    x, z = frame.origin_x + columns * 0.05, frame.origin_z + rows * 0.05
    assert (world.clearance(x, z) > -0.1).all(), "a path leads through a wall"


def back_through_a_door_that_later_frames_close(visited_is_free):
    """The way back through a door, as a fraction of the cells of the first room that are reachable again."""
    walls = (Box(2.9, 0.0, 3.1, 1.6, 2.5), Box(2.9, 2.4, 3.1, 4.0, 2.5))
    world = BoxWorld(6.0, 4.0, walls, Camera(64, 64))
    tolerance = DepthTolerance(relative=0.05, visited_is_free=visited_is_free)
    occupancy = OccupancyMap(world.camera, world.robot, max_range=5.0, errors=tolerance)
    world.reset(1.0, 2.0, np.radians(-90.0))
    look_around(world, occupancy)
    world.reset(1.0, 2.0, np.radians(-90.0))
    for _ in range(16):
        assert not world.step(Action.FORWARD)
        occupancy.update(world.observe().depth, world.pose)
    x, _, z = world.pose[:3, 3]
    assert x == pytest.approx(5.0)
    world.reset(x, z, np.radians(90.0))
    for _ in range(40):  # a network that sees the wall go on where the door is
        closed = np.minimum(world.observe().depth, np.float32(x - 3.1))
        occupancy.update(closed, world.pose)
    here, cells = occupancy.frame.cell(x, z), occupancy.cells
    open_cells = process_map(cells, 4.0, [here]) | (occupancy.trace & (cells != OCCUPIED))
    rows, columns = occupancy.frame.cells(np.linspace(0.5, 2.5, 40), np.full(40, z))
    return np.isfinite(distance_field(open_cells, here)[rows, columns]).mean()


def test_floor_that_the_robot_has_been_on_stays_free_whatever_later_frames_show():
    assert back_through_a_door_that_later_frames_close(visited_is_free=True) == 1.0
    assert back_through_a_door_that_later_frames_close(visited_is_free=False) == 0.0


def test_the_trace_is_the_way_of_the_robots_centre():
    world = BoxWorld(6.0, 4.0, camera=Camera(64, 64))
    occupancy = OccupancyMap(world.camera, world.robot, errors=DepthTolerance(visited_is_free=True))
    world.reset(1.0, 2.0, np.radians(-100.0))
    for _ in range(12):
        occupancy.update(world.observe().depth, world.pose)
        assert not world.step(Action.FORWARD)
    rows, columns = np.nonzero(occupancy.trace)
    x, z = np.transpose([occupancy.frame.centre(*cell) for cell in zip(rows, columns, strict=True)])
    along = (x - 1.0) * np.cos(np.radians(10.0)) + (z - 2.0) * np.sin(np.radians(10.0))
    across = (z - 2.0) * np.cos(np.radians(10.0)) - (x - 1.0) * np.sin(np.radians(10.0))
    assert np.abs(across).max() < 3 * 0.05
    assert (along.min(), along.max()) == pytest.approx((0.0, 11 * 0.25), abs=0.1)
    assert len(rows) * 0.05**2 == pytest.approx(3 * 0.05 * 2.75, rel=0.25)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_frames_without_depth_free_the_footprint_and_nothing_else(value):
    world = BoxWorld(4.0, 4.0)
    occupancy = OccupancyMap(world.camera, world.robot)
    occupancy.update(np.full((64, 64), value, np.float32), world.pose)
    free = np.count_nonzero(occupancy.cells == FREE) * 0.05**2
    assert 0.0 < free < 2.0 * np.pi * world.robot.radius**2
    assert not (occupancy.cells == OCCUPIED).any()


def test_an_obstacle_that_the_body_met_is_entered_ahead_of_it():
    world = BoxWorld(4.0, 4.0)
    occupancy = OccupancyMap(world.camera, Robot())
    look_around(world, occupancy)
    world.reset(2.0, 2.0, 0.0)
    assert state(occupancy, 2.0, 1.84) == FREE
    occupancy.mark_contact(world.pose)
    assert state(occupancy, 2.0, 1.84) == OCCUPIED
    assert state(occupancy, 2.0, 2.0) == FREE
    look_around(world, occupancy)
    assert state(occupancy, 2.0, 1.84) == OCCUPIED, "what the camera cannot see is still there"


def test_the_contact_of_a_very_thin_robot_leaves_the_cell_that_it_stands_on_free():
    world = BoxWorld(4.0, 4.0, robot=Robot(radius=0.01))
    occupancy = OccupancyMap(world.camera, world.robot)
    for degrees in range(0, 360, 45):
        world.reset(2.001, 2.001, np.radians(degrees))
        occupancy.update(world.observe().depth, world.pose)
        occupancy.mark_contact(world.pose)
        assert state(occupancy, 2.001, 2.001) == FREE


def test_floor_that_depth_errors_lift_stays_free_and_a_table_stays_an_obstacle():
    """Depth 20 % short lifts the floor by 0.25 m: more than the robot climbs, less than climb and tolerance."""
    for errors, expected in ((EXACT, OCCUPIED), (DepthTolerance(relative=0.1), FREE)):
        world = BoxWorld(5.0, 4.0, (TABLE,))
        world.reset(2.0, 2.0, 0.0)
        occupancy = OccupancyMap(world.camera, world.robot, errors=errors)
        look_around(world, occupancy, lambda depth: 0.8 * depth)
        assert state(occupancy, 2.0, 0.7) == expected
        assert (state(occupancy, [2.8, 2.9, 3.0], [1.6, 1.6, 1.6]) == OCCUPIED).any(), "the table, moved nearer"


def test_wrong_depth_along_the_edges_of_the_image_is_not_used():
    def spoil_edges(depth):
        spoilt = 0.4 * depth
        spoilt[3:-3, 3:-3] = depth[3:-3, 3:-3]
        return spoilt

    for border, imprisoned in ((0, True), (3, False)):
        world = BoxWorld(6.0, 6.0)
        occupancy = OccupancyMap(world.camera, world.robot, errors=DepthTolerance(border=border))
        look_around(world, occupancy, spoil_edges)
        here = occupancy.frame.cell(3.0, 3.0)
        distance = distance_field(process_map(occupancy.cells, 3.0, [here]), here)
        reached = np.count_nonzero(np.isfinite(distance)) * 0.05**2
        assert (reached < 2.0) if imprisoned else (reached > 15.0)


def test_the_border_only_narrows_the_view():
    """The map of cropped images agrees with that of whole ones wherever it knows something."""
    world = BoxWorld(5.0, 4.0, (TABLE,))
    world.reset(2.0, 2.0, 0.0)
    maps = [OccupancyMap(world.camera, world.robot, errors=DepthTolerance(border=border)) for border in (0, 5)]
    for occupancy in maps:
        look_around(world, occupancy)
    whole, cropped = (occupancy.cells for occupancy in maps)
    known = cropped != UNKNOWN
    assert known.sum() > 0.9 * (whole != UNKNOWN).sum()
    assert (whole[known] == cropped[known]).mean() > 0.99


def test_a_step_in_depth_that_is_blurred_to_a_ramp_makes_no_obstacle_of_the_floor():
    """A cupboard in the middle of a room, as a network sees it from one place."""
    world = BoxWorld(6.0, 6.0, (Box(2.6, 2.6, 3.4, 3.4, 1.4),), Camera(128, 128))
    x, z = np.meshgrid(np.arange(0.5, 5.5, 0.05) + 0.025, np.arange(0.5, 5.5, 0.05) + 0.025)
    floor = world.clearance(x, z) > 0.15
    taken = {}
    for incidence in (90.0, 81.0):
        errors = DepthTolerance(relative=0.02, incidence=incidence)
        occupancy = OccupancyMap(world.camera, world.robot, errors=errors)
        world.reset(1.2, 3.0, 0.0)
        look_around(world, occupancy, lambda depth: gaussian_filter(depth, 1.5))
        cells = state(occupancy, x, z)
        taken[incidence] = (cells[floor] == OCCUPIED).mean()
        assert (state(occupancy, [2.58, 2.62], [3.0, 3.0]) == OCCUPIED).any(), "the cupboard itself"
    assert taken[81.0] < 0.5 * taken[90.0], taken
    assert taken[90.0] > 0.005


def test_surfaces_seen_at_a_right_angle_are_mapped_whatever_the_limit():
    world = BoxWorld(5.0, 4.0, (TABLE,))
    maps = [OccupancyMap(world.camera, world.robot, errors=DepthTolerance(incidence=limit)) for limit in (90.0, 81.0)]
    for occupancy in maps:
        world.reset(2.0, 2.0, 0.0)
        look_around(world, occupancy)
    whole, limited = (occupancy.cells for occupancy in maps)
    known = limited != UNKNOWN
    assert known.sum() > 0.95 * (whole != UNKNOWN).sum()
    assert (whole[known] == limited[known]).mean() > 0.98


@pytest.mark.parametrize(("errors", "expected"), [(EXACT, OCCUPIED), (DepthTolerance(relative=0.1), FREE)])
def test_one_look_outweighs_many_wrong_ones_from_afar_if_depth_is_inexact(errors, expected):
    world = BoxWorld(6.0, 6.0, camera=Camera(64, 64))
    world.reset(3.0, 5.0, 0.0)
    occupancy = OccupancyMap(world.camera, world.robot, errors=errors)
    depth = world.observe().depth
    for _ in range(5):
        occupancy.update(np.minimum(depth, 2.5), world.pose)
    assert state(occupancy, 3.0, 2.5 - 1e-3) == OCCUPIED
    occupancy.update(depth, world.pose)
    assert state(occupancy, 3.0, 2.5 - 1e-3) == expected


def test_each_frame_counts_once_for_each_cell_that_it_shows():
    """Known cells change with the frame that shows them, and with no other; the footprint alone needs no look."""
    world = BoxWorld(5.0, 4.0, (TABLE,), Camera(64, 64))
    world.reset(2.0, 2.0, 0.3)
    occupancy = OccupancyMap(world.camera, world.robot, resolution=0.1)
    counted = {}
    for step in range(40):
        occupancy.update(world.observe().depth, world.pose)
        for row, column in np.argwhere(occupancy.seen):
            cell = tuple(np.round(occupancy.frame.centre(row, column), 3))
            counted[cell] = counted.get(cell, 0) + 1
        world.step(Action(step % 2))
    assert occupancy.views.dtype == np.int32
    assert occupancy.seen.dtype == occupancy.visited.dtype == np.bool_
    rows, columns = np.nonzero(occupancy.views)
    views = {
        tuple(np.round(occupancy.frame.centre(row, column), 3)): occupancy.views[row, column]
        for row, column in zip(rows, columns, strict=True)
    }
    assert views == counted, "the counts moved with the grid as it grew"
    assert max(counted.values()) > 5
    known = occupancy.cells != UNKNOWN
    assert not (occupancy.views[~known] > 0).any()
    assert (known & (occupancy.views == 0) <= occupancy.visited).all()


def test_what_the_last_frame_shows_lies_in_its_field_of_view():
    world = BoxWorld(8.0, 8.0, camera=Camera(64, 64))
    occupancy = OccupancyMap(world.camera, world.robot, resolution=0.1)
    for yaw in (0.0, 1.0, -2.5):
        world.reset(4.0, 4.0, yaw)
        occupancy.update(world.observe().depth, world.pose)
        rows, columns = np.nonzero(occupancy.seen)
        assert len(rows) > 200
        x = occupancy.frame.origin_x + (columns + 0.5) * 0.1 - 4.0
        z = occupancy.frame.origin_z + (rows + 0.5) * 0.1 - 4.0
        ahead, right = -np.sin(yaw) * x - np.cos(yaw) * z, np.cos(yaw) * x - np.sin(yaw) * z
        # 90 degrees of view and a cell's half diagonal; 3 m of range.
        assert (np.abs(right) <= ahead + 0.15).all()
        assert np.hypot(ahead, right).max() <= 3.0 + 0.1
    occupancy.update(np.zeros((64, 64), np.float32), world.pose)
    assert not occupancy.seen.any(), "a frame without depth tells nothing"


def test_where_the_body_has_been_is_visited():
    world = BoxWorld(8.0, 8.0, camera=Camera(16, 16))
    occupancy = OccupancyMap(world.camera, world.robot)
    places = []
    for yaw in (0.0, 0.0, 0.0, np.pi / 2.0, np.pi / 2.0):
        world.reset(*world.pose[[0, 2], 3], yaw)
        occupancy.update(world.observe().depth, world.pose)
        places.append(world.pose[[0, 2], 3])
        world.step(Action.FORWARD)
    rows, columns = np.mgrid[: occupancy.frame.rows, : occupancy.frame.columns]
    x = occupancy.frame.origin_x + (columns + 0.5) * 0.05
    z = occupancy.frame.origin_z + (rows + 0.5) * 0.05
    nearest = np.min([np.hypot(x - px, z - pz) for px, pz in places], axis=0)
    assert occupancy.visited[nearest <= world.robot.radius - 1e-6].all()
    assert not occupancy.visited[nearest > world.robot.radius + 0.05].any()
    assert (occupancy.cells[occupancy.visited] == FREE).all()
    before = occupancy.visited.copy()
    occupancy.mark_contact(world.pose)
    np.testing.assert_array_equal(occupancy.visited, before)


def test_looks_at_what_the_body_met_are_not_counted():
    """Such a cell stays as it is whatever a frame shows in its place."""
    world = BoxWorld(6.0, 6.0, camera=Camera(64, 64))
    world.reset(3.0, 3.0, 0.0)
    occupancy = OccupancyMap(world.camera, world.robot)
    occupancy.update(world.observe().depth, world.pose)
    occupancy.mark_contact(world.pose)
    before = occupancy.views.copy()
    cell = tuple(int(index) for index in occupancy.frame.cells(3.0, 2.84))
    assert state(occupancy, 3.0, 2.84) == OCCUPIED
    world.reset(3.0, 4.0, 0.0)
    occupancy.update(world.observe().depth, world.pose)
    assert state(occupancy, 3.0, 2.84) == OCCUPIED
    assert not occupancy.seen[cell]
    assert (occupancy.views - before)[occupancy.seen].min() == 1
