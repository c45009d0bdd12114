"""Against heights and borders that can be written down."""

import numpy as np
import pytest

from deux.contracts import Robot
from deux.geometry.grid import GridFrame
from deux.scenes.heightfield import walkable_surface

ROBOT = Robot(height=1.5, max_climb=0.2)
FRAME = GridFrame(0.0, 0.0, rows=20, columns=40, resolution=0.1)


def surface(mesh, near=0.0, low=-2.0, high=2.0, robot=ROBOT):
    return walkable_surface(mesh, FRAME, robot, near, low, high)


def test_a_ramp_has_the_height_of_its_plane_at_the_upper_edge_of_each_column(mesh_of, sheet):
    ramp = sheet([0, 0, 0], [4, 1.6, 0], [4, 1.6, 2], [0, 0, 2])
    found = surface(mesh_of(ramp))
    np.testing.assert_allclose(found.height, np.broadcast_to(0.04 * np.arange(1, 41), (20, 40)), atol=1e-5)
    assert not found.blocked.any()


@pytest.mark.parametrize(("angle", "walkable"), [(44.0, True), (46.0, False)])
def test_slopes_are_walkable_up_to_45_degrees(mesh_of, sheet, angle, walkable):
    top = 2.0 * np.tan(np.radians(angle))
    ramp = sheet([0, 0, 0], [2, top, 0], [2, top, 2], [0, 0, 2])
    assert (~np.isnan(surface(mesh_of(ramp), high=5.0).height[:, :20])).all() == walkable


def test_faces_may_be_turned_either_way(mesh_of, slab):
    box = slab([0, -0.1, 0], [4, 0, 2])
    turned = box.copy()
    turned.invert()
    np.testing.assert_array_equal(surface(mesh_of(box)).height, surface(mesh_of(turned)).height)


@pytest.mark.parametrize(("step", "passes"), [(0.2, True), (0.21, False)])
def test_a_step_is_passed_up_to_the_climb_and_its_upper_side_is_the_obstacle(mesh_of, slab, step, passes):
    found = surface(mesh_of(slab([0, -1, 0], [2, 0, 2]), slab([2, -1, 0], [4, step, 2])))
    expected = np.zeros(FRAME.shape, bool)
    expected[:, 20] = not passes
    np.testing.assert_array_equal(found.blocked, expected)


@pytest.mark.parametrize(("bottom", "stands"), [(1.5, True), (1.45, False)])
def test_a_robot_stands_where_its_height_fits(mesh_of, slab, bottom, stands):
    found = surface(mesh_of(slab([0, -1, 0], [4, 0, 2]), slab([2, bottom, 0], [4, 2.5, 2])))
    assert (found.height[:, 25] == 0.0).all() == stands
    assert (found.height[:, 5] == 0.0).all()


def test_what_is_low_enough_to_be_climbed_is_walked_on_however_steep(mesh_of, slab, sheet):
    """A kerb of two steep sheets, 15 cm high, and the same 40 cm high."""
    floor = slab([0, -1, 0], [4, 0, 2])
    for height, free in ((0.15, True), (0.4, False)):
        kerb = sheet([2, 0, 0], [2.05, height, 0], [2.05, height, 2], [2, 0, 2])
        found = surface(mesh_of(floor, kerb))
        assert (~found.blocked[:, 20]).all() == free


def test_an_upright_sheet_blocks_every_column_that_it_crosses(mesh_of, slab, sheet):
    """Its columns are those that a finely sampled line from corner to corner passes through."""
    floor = slab([0, -1, 0], [4, 0, 2])
    wall = sheet([0.33, 0, 0.12], [3.71, 0, 1.87], [3.71, 2.5, 1.87], [0.33, 2.5, 0.12])
    along = np.linspace(0.0, 1.0, 20_001)
    rows, columns = FRAME.cells(0.33 + along * 3.38, 0.12 + along * 1.75)
    expected = np.zeros(FRAME.shape, bool)
    expected[rows, columns] = True
    np.testing.assert_array_equal(surface(mesh_of(floor, wall)).blocked, expected)


def test_of_several_storeys_the_one_near_the_height_counts(mesh_of, slab):
    mesh = mesh_of(*(slab([0, y - 0.2, 0], [4, y, 2]) for y in (-3.0, 0.0, 3.0)))
    for near in (-3.0, 0.0, 3.0):
        assert (surface(mesh, near, near - 1.5, near + 1.5).height == near).all()
    assert np.isnan(surface(mesh, 1.5, 1.0, 2.0).height).all()


def test_random_boxes_agree_with_brute_force(mesh_of, slab):
    """Box by box, column by column that it reaches into: tops with nothing in the robot's height above them."""
    rng = np.random.default_rng(4)
    low = rng.integers(0, [35, 20, 15], (60, 3)) / 10 + 0.03
    high = np.minimum(low + rng.integers(1, [12, 6, 10], (60, 3)) / 10 + 0.04, [3.99, 4.0, 1.99])
    boxes = [([0, -0.5, 0], [4, 0, 2]), *zip(low.tolist(), high.tolist(), strict=True)]
    found = surface(mesh_of(*(slab(*box) for box in boxes)), high=5.0)
    for row in range(FRAME.rows):
        for column in range(FRAME.columns):
            x0, x1, z0, z1 = column / 10, (column + 1) / 10, row / 10, (row + 1) / 10
            here = [(a[1], b[1]) for a, b in boxes if a[0] < x1 and b[0] > x0 and a[2] < z1 and b[2] > z0]
            tops = [top for _, top in here if not any(b < top + 1.499 and t > top + 1e-6 for b, t in here)]
            assert found.height[row, column] == pytest.approx(min(tops), abs=1e-5)
