import math

import numpy as np
import pytest
from scipy import ndimage

from deux.geometry.grid import FreeSpace, GridFrame
from deux.simulator.body import Body

STEP = 0.25


def floor(free: np.ndarray, resolution: float = 0.05, origin: tuple[float, float] = (-3.0, -3.0)) -> FreeSpace:
    clearance = (ndimage.distance_transform_edt(free) * resolution).astype(np.float32)
    return FreeSpace(GridFrame(*origin, *free.shape, resolution), free, clearance, 0.0)


def half_plane(normal: np.ndarray, offset: float) -> FreeSpace:
    """6 x 6 m of floor, free where (x, z) . normal > offset, up to whole cells."""
    frame = GridFrame(-3.0, -3.0, 120, 120)
    rows, columns = np.indices(frame.shape)
    x, z = frame.origin_x + (columns + 0.5) * 0.05, frame.origin_z + (rows + 0.5) * 0.05
    return floor(x * normal[0] + z * normal[1] > offset)


def yaw_towards(direction: np.ndarray) -> float:
    return math.atan2(-direction[0], -direction[1])


def test_on_open_floor_it_goes_straight() -> None:
    body = Body(floor(np.ones((120, 120), dtype=bool)))
    for yaw in np.linspace(-np.pi, np.pi, 25):
        x, z, collided = body.move(0.3, -0.2, yaw, STEP)
        assert (x, z) == pytest.approx((0.3 - STEP * math.sin(yaw), -0.2 - STEP * math.cos(yaw)), abs=1e-6)
        assert not collided


@pytest.mark.parametrize("angle", [*range(0, 90, 7), 90])
def test_it_slides_along_walls_of_any_direction(angle: int) -> None:
    """At an angle to the wall it moves by STEP cos(angle) along it, whatever the wall's direction on the grid."""
    rng = np.random.default_rng(angle)
    errors = []
    for _ in range(40):
        direction = rng.uniform(0, 2 * np.pi)
        normal = np.array([math.cos(direction), math.sin(direction)])
        along = np.array([-normal[1], normal[0]]) * rng.choice([-1, 1])
        body = Body(half_plane(normal, rng.uniform(0, 0.05)))
        place = 0.6 * normal + rng.uniform(-1.0, 1.0) * along
        for _ in range(4):
            place = np.array(body.move(*place, yaw_towards(-normal), STEP)[:2])
        heading = math.cos(math.radians(angle)) * along - math.sin(math.radians(angle)) * normal
        x, z, collided = body.move(*place, yaw_towards(heading), STEP)
        errors.append(abs((np.array([x, z]) - place) @ along - STEP * math.cos(math.radians(angle))))
        assert collided or angle == 0
    assert np.median(errors) < 0.001
    assert np.max(errors) < 0.005


@pytest.mark.parametrize("quarter", range(4))
def test_along_the_grid_slides_are_exact_and_head_on_it_stops(quarter: int) -> None:
    angle = quarter * math.pi / 2
    normal = np.round([math.cos(angle), math.sin(angle)])
    along = np.array([-normal[1], normal[0]])
    body = Body(half_plane(normal, 0.0))
    x, z, collided = body.move(*(0.1 * normal), yaw_towards(-normal), STEP)
    assert np.array([x, z]) @ normal == pytest.approx(0.0, abs=1e-5)
    assert collided
    again = body.move(x, z, yaw_towards(-normal), STEP)
    assert again == (pytest.approx(x, abs=1e-6), pytest.approx(z, abs=1e-6), True)
    for degrees, expected in ((30, 0.2165), (45, 0.1768), (60, 0.125)):  # as measured in Habitat-Sim
        heading = math.cos(math.radians(degrees)) * along - math.sin(math.radians(degrees)) * normal
        end = np.array(body.move(x, z, yaw_towards(heading), STEP)[:2])
        assert (end - (x, z)) @ along == pytest.approx(expected, abs=5e-5)


def test_in_a_room_it_ends_at_the_place_nearest_to_where_it_was_told_to_go() -> None:
    free = np.zeros((30, 40), dtype=bool)
    free[5:20, 6:30] = True
    body = Body(floor(free))
    low, high = np.array([6, 5]) * 0.05 - 3.0, np.array([30, 20]) * 0.05 - 3.0
    rng = np.random.default_rng(0)
    for _ in range(500):
        start = rng.uniform(low, high)
        yaw = rng.uniform(-np.pi, np.pi)
        target = start + STEP * np.array([-math.sin(yaw), -math.cos(yaw)])
        np.testing.assert_allclose(body.move(*start, yaw, STEP)[:2], np.clip(target, low, high), atol=1e-5)


def test_round_a_corner_it_goes_on_to_where_it_was_told_to_go() -> None:
    free = np.ones((60, 60), dtype=bool)
    free[30:, :30] = False  # the corner is at x = z = -1.5
    body = Body(floor(free))
    for degrees in (5, 20, 40):
        yaw = yaw_towards(np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))]))
        straight = -1.5 - 0.1 - STEP * math.sin(yaw), -1.5 - 1e-4 - STEP * math.cos(yaw)
        assert straight[0] > -1.5
        assert body.move(-1.5 - 0.1, -1.5 - 1e-4, yaw, STEP)[:2] == pytest.approx(straight, abs=1e-4)


@pytest.mark.parametrize("degrees", range(0, 91, 9))
def test_it_passes_corridors_one_cell_wide_of_any_direction(degrees: int) -> None:
    along = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    free = np.zeros((140, 140), dtype=bool)
    columns, rows = np.floor(20.0 + np.linspace(0.0, 100.0, 20_001)[:, None] * along).astype(int).T
    free[rows, columns] = True
    free[rows[1:], columns[:-1]] = True  # no step from cell to cell across a corner
    body = Body(floor(free))
    rng = np.random.default_rng(degrees)
    place = np.array([-2.0, -2.0])
    for _ in range(25):
        place = np.array(body.move(*place, yaw_towards(along) + rng.normal(0.0, 0.1), STEP)[:2])
    assert (place + 2.0) @ along > 4.9


def test_collided_is_habitats_rule() -> None:
    """True when |moved|^2 + 1e-5 < |asked|^2; 2e-5 m^2 are 0.04 mm of 0.25 m."""
    body = Body(half_plane(np.array([0.0, 1.0]), 0.0))
    for start in np.linspace(0.2, 0.3, 201):
        x, z, collided = body.move(0.0, start, 0.0, STEP)
        assert collided == (x**2 + (z - start) ** 2 + 1e-5 < STEP**2)
    assert not body.move(0.0, 0.3, 0.0, STEP)[2]
    assert body.move(0.0, 0.2, 0.0, STEP)[2]


def test_it_passes_a_doorway_and_never_a_wall() -> None:
    free = np.ones((80, 80), dtype=bool)
    free[40] = False
    free[40, 30:36] = True
    body = Body(floor(free))
    door_x, wall_z = -3.0 + 33 * 0.05, -3.0 + 40.5 * 0.05
    x, z = door_x, wall_z + 0.5
    for _ in range(4):
        x, z, _ = body.move(x, z, 0.0, STEP)
    assert z < wall_z - 0.3
    for start in np.linspace(-2.9, 0.9, 40):
        for yaw in np.radians([-80, -45, -10, 0, 10, 45, 80]):
            if abs(start - door_x) > 0.6:
                assert body.move(start, wall_z + 0.04, yaw, STEP)[1] > wall_z


def test_cells_that_touch_at_a_corner_are_no_passage() -> None:
    free = np.zeros((40, 40), dtype=bool)
    free[5:20, 5:20] = free[20:35, 20:35] = True
    body = Body(floor(free))
    corner = -3.0 + 20 * 0.05
    for offset in (-0.01, 0.0, 0.01):
        x, z = corner - 0.1 + offset, corner - 0.1 - offset
        for _ in range(3):
            x, z, _ = body.move(x, z, yaw_towards(np.array([1.0, 1.0])), STEP)
            assert min(x, z) < corner


def test_it_comes_to_rest_inside_a_cell() -> None:
    """On a border, rounding would decide whether the body still stands on free floor at its next step."""
    free = np.zeros((16, 16), dtype=bool)
    free[2:14, 7:14] = True
    body = Body(floor(free, resolution=0.25, origin=(0.0, 0.0)))
    x, z = 7.5 * 0.25, 8.5 * 0.25
    for _ in range(9):  # steps of a 16th of a cell reach the border of column 7 exactly
        x, z, _ = body.move(x, z, math.pi / 2, 0.25 / 16)
    assert 7 * 0.25 < x < 7 * 0.25 + 1e-4


@pytest.mark.parametrize("seed", range(30))
def test_on_any_floor_it_stays_on_it_and_is_never_stuck(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hills = ndimage.gaussian_filter(rng.normal(size=(60, 80)), rng.uniform(0.5, 4.0))
    regions, _ = ndimage.label(hills > np.quantile(hills, rng.uniform(0.1, 0.6)))
    free = regions == np.bincount(regions[regions > 0]).argmax()
    space = floor(free)
    body = Body(space)
    x, z = space.frame.centre(*rng.permutation(np.argwhere(free))[0])
    for step in range(100):
        start = x, z
        # Any step that is longer than the widest gap between checks could tunnel: also try a very long one.
        length = STEP if step % 5 else 1.5
        x, z, _ = body.move(x, z, rng.uniform(-np.pi, np.pi), length)
        assert body.stands_at(x, z)
        assert math.dist(start, (x, z)) <= length + 1e-6
        if step % 10 == 0:
            moves = [math.dist((x, z), body.move(x, z, yaw, STEP)[:2]) for yaw in np.arange(36) * np.pi / 18]
            assert max(moves) > 0.02


def test_from_the_stairs_behind_a_slanted_wall_it_gets_away() -> None:
    rng = np.random.default_rng(0)
    normal = np.array([math.cos(0.6), math.sin(0.6)])
    space = half_plane(normal, 0.0)
    body = Body(space)
    behind = 0
    for start in rng.uniform(-1.5, 1.5, (3000, 2)):
        if not body.stands_at(*start) or start @ normal > 0.05:
            continue
        head_on = np.array(body.move(*start, yaw_towards(-normal), STEP)[:2])
        behind += (head_on - start) @ normal > 0.001
        assert body.stands_at(*head_on)
        away = np.array(body.move(*start, yaw_towards(normal), STEP)[:2])
        np.testing.assert_allclose(away, start + STEP * normal, atol=1e-6)
    assert behind > 10


def test_off_the_floor_it_does_not_move() -> None:
    body = Body(half_plane(np.array([0.0, 1.0]), 0.0))
    for place in ((0.02, -1.02), (99.02, 0.02)):
        assert body.move(*place, 0.0, STEP) == (pytest.approx(place[0]), pytest.approx(place[1]), True)
    assert not body.stands_at(0.0, -1.0)
    assert not body.stands_at(99.0, 0.0)
