"""Floor plans against plain geometry, over many seeds."""

from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from deux_plugins.scenes.apartments.layout import make_floor_plan
from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.floor_plan import WALL, FloorPlan

SEEDS = range(150)


@pytest.fixture(scope="module")
def plans() -> list[FloorPlan]:
    return [make_floor_plan(Draws(seed, "floor plan")) for seed in SEEDS]


def test_size_and_rooms(plans: list[FloorPlan]):
    for plan in plans:
        assert 30.0 < sum(room.area for room in plan.rooms) < 90.0
        assert 4 <= len(plan.rooms) <= 7
        kinds = [room.kind for room in plan.rooms]
        assert {"living room", "bedroom", "kitchen", "bathroom"} <= set(kinds)
        assert min(min(room.x1 - room.x0, room.z1 - room.z0) for room in plan.rooms) >= 1.2
        assert all(2.4 < room.height < 2.8 for room in plan.rooms)
    assert {len(plan.rooms) for plan in plans} >= {4, 5, 6, 7}
    assert any("hallway" in [room.kind for room in plan.rooms] for plan in plans)


def test_rooms_are_a_walls_thickness_apart(plans: list[FloorPlan]):
    for plan in plans:
        for a, b in combinations(plan.rooms, 2):
            gap = max(a.x0 - b.x1, b.x0 - a.x1, a.z0 - b.z1, b.z0 - a.z1)
            assert gap > WALL - 1e-9


def test_all_rooms_are_joined_by_doorways_and_some_by_two_ways(plans: list[FloorPlan]):
    loops = 0
    for plan in plans:
        near, far = np.transpose([door.rooms for door in plan.doors])
        count = len(plan.rooms)
        graph = coo_array((np.ones(len(near)), (near, far)), shape=(count, count))
        assert connected_components(graph, directed=False)[0] == 1
        loops += len(plan.doors) >= count
    assert loops > len(plans) // 10


def test_doorways_lie_in_the_wall_between_their_rooms(plans: list[FloorPlan]):
    for plan in plans:
        for door in plan.doors:
            assert door.high - door.low >= 0.9 - 1e-9
            assert (door.bottom, door.top) == (0.0, 2.05)
            near, far = (plan.rooms[index] for index in door.rooms)
            along_x = door.axis == "x"
            ends = (near.z1, far.z0) if along_x else (near.x1, far.x0)
            assert ends == pytest.approx((door.wall - WALL / 2, door.wall + WALL / 2))
            for room in (near, far):
                low, high = (room.x0, room.x1) if along_x else (room.z0, room.z1)
                assert low + 0.1 < door.low < door.high < high - 0.1


def test_windows_lie_in_outer_walls_under_the_ceiling(plans: list[FloorPlan]):
    for plan in plans:
        width, depth = max(room.x1 for room in plan.rooms), max(room.z1 for room in plan.rooms)
        for window in plan.windows:
            room = plan.rooms[window.rooms[0]]
            outer, low, high = (
                ((WALL / 2, depth), room.x0, room.x1) if window.axis == "x" else ((WALL / 2, width), room.z0, room.z1)
            )
            assert window.wall == pytest.approx(outer[0]) or window.wall == pytest.approx(outer[1])
            assert low < window.low < window.high < high
            assert 0.8 < window.bottom < window.top < room.height
        for a, b in combinations(plan.windows, 2):
            same_wall = (a.axis, a.wall, a.rooms) == (b.axis, b.wall, b.rooms)
            assert not same_wall or a.high < b.low or b.high < a.low
