"""Floor plans of houses against plain geometry, over many seeds."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from deux_plugins.scenes.houses.generator import house_plan
from deux_plugins.scenes.parts.floor_plan import WALL, FloorPlan
from deux_plugins.scenes.parts.walls import NICHE

SEEDS = range(200)


@pytest.fixture(scope="module")
def plans() -> list[FloorPlan]:
    return [house_plan(seed) for seed in SEEDS]


def area(plan: FloorPlan) -> float:
    return sum(room.area for room in plan.rooms)


def test_size_and_rooms(plans: list[FloorPlan]):
    for plan in plans:
        assert 150.0 <= area(plan) <= 500.0
        assert 8 <= len(plan.rooms) <= 25
        kinds = {room.kind for room in plan.rooms}
        assert {"living room", "bedroom", "kitchen", "bathroom", "library"} <= kinds
        assert min(min(room.x1 - room.x0, room.z1 - room.z0) for room in plan.rooms) >= 1.39
        assert all(2.4 <= room.height <= 4.3 for room in plan.rooms)
    areas = np.array([area(plan) for plan in plans])
    assert np.histogram(areas, bins=(150, 250, 350, 500))[0].min() > len(plans) // 6
    assert {len(plan.rooms) for plan in plans} >= set(range(10, 25))


def test_sizes_are_uneven(plans: list[FloorPlan]):
    """Closets beside halls: in most houses the largest room is more than six times the smallest."""
    ratios = [max(room.area for room in plan.rooms) / min(room.area for room in plan.rooms) for plan in plans]
    assert np.median(ratios) > 6.0
    assert any(len({room.height for room in plan.rooms}) > 2 for plan in plans)


def test_no_room_is_as_long_as_a_corridor(plans: list[FloorPlan]):
    ratios: dict[bool, list[float]] = {True: [], False: []}
    for room in (room for plan in plans for room in plan.rooms):
        short, long = sorted((room.x1 - room.x0, room.z1 - room.z0))
        ratios[room.kind == "corridor"].append(long / short)
    assert max(ratios[False]) < 4.0 < np.median(ratios[True])


def test_the_range_of_areas_is_kept():
    for seed in range(30):
        assert 250.0 <= area(house_plan(seed, 250, 320)) <= 320.0


def test_rooms_are_a_walls_thickness_apart(plans: list[FloorPlan]):
    for plan in plans:
        for a, b in combinations(plan.rooms, 2):
            assert max(a.x0 - b.x1, b.x0 - a.x1, a.z0 - b.z1, b.z0 - a.z1) > WALL - 1e-9


def test_all_rooms_are_joined(plans: list[FloorPlan]):
    for plan in plans:
        near, far = np.transpose([door.rooms for door in plan.doors])
        count = len(plan.rooms)
        graph = coo_array((np.ones(len(near)), (near, far)), shape=(count, count))
        assert connected_components(graph, directed=False)[0] == 1


def test_ways_through_a_house_differ(plans: list[FloorPlan]):
    """Corridors, rooms behind rooms, loops, dead ends and open plans: all of them are frequent."""
    met: Counter[str] = Counter()
    for plan in plans:
        corridors = {index for index, room in enumerate(plan.rooms) if room.kind == "corridor"}
        at_corridor = {index for door in plan.doors if corridors & set(door.rooms) for index in door.rooms}
        doors = Counter(index for door in plan.doors for index in door.rooms)
        met["corridor"] += bool(corridors)
        met["room behind a room"] += len(at_corridor | corridors) < len(plan.rooms)
        met["loop"] += len(plan.doors) >= len(plan.rooms)
        met["dead end"] += min(doors.values()) == 1
        met["open plan"] += any(door.high - door.low > 2.0 for door in plan.doors)
        met["corner left out"] += area(plan) < 0.9 * (
            max(room.x1 for room in plan.rooms) * max(room.z1 for room in plan.rooms)
        )
    assert min(met.values()) > len(plans) // 5, met


def test_private_rooms_are_not_passed_through_where_another_way_exists(plans: list[FloorPlan]):
    doors: list[int] = []
    for plan in plans:
        count = Counter(index for door in plan.doors for index in door.rooms)
        doors += [count[index] for index, room in enumerate(plan.rooms) if room.kind in ("bathroom", "closet")]
    assert np.mean(np.array(doors) == 1) > 0.85


def test_doorways_lie_in_the_wall_between_their_rooms(plans: list[FloorPlan]):
    for plan in plans:
        for door in plan.doors:
            assert door.high - door.low >= 0.9 - 1e-9
            assert door.bottom == 0.0
            near, far = (plan.rooms[index] for index in door.rooms)
            assert 2.0 <= door.top <= min(near.height, far.height) - 0.1
            along_x = door.axis == "x"
            ends = (near.z1, far.z0) if along_x else (near.x1, far.x0)
            assert ends == pytest.approx((door.wall - WALL / 2, door.wall + WALL / 2))
            for room in (near, far):
                low, high = (room.x0, room.x1) if along_x else (room.z0, room.z1)
                assert low + 0.1 < door.low < door.high < high - 0.1


def test_windows_open_into_no_room(plans: list[FloorPlan]):
    """The niche of a window, which is deeper than a wall, lies in its own wall and in no other room."""
    for plan in plans:
        for window in plan.windows:
            room = plan.rooms[window.rooms[0]]
            along_x = window.axis == "x"
            middle = (room.z0 + room.z1) / 2 if along_x else (room.x0 + room.x1) / 2
            ends = sorted((window.wall, window.wall + NICHE * (1.0 if window.wall > middle else -1.0)))
            low, high = (room.x0, room.x1) if along_x else (room.z0, room.z1)
            assert low < window.low < window.high < high
            assert 0.8 < window.bottom < window.top < room.height
            for other in plan.rooms:
                along, across = ((other.x0, other.x1), (other.z0, other.z1))
                if not along_x:
                    along, across = across, along
                inside = window.low < along[1] and along[0] < window.high and ends[0] < across[1] - 1e-9
                assert other is room or not (inside and across[0] + 1e-9 < ends[1]), (other.kind, room.kind)
