"""Which floors of analytic buildings a `SceneArea` chooses."""

import logging
import re
from dataclasses import replace

import numpy as np
import pytest

from deux.contracts import Robot, Scene, SceneArea
from deux.errors import DeuxError
from deux.scenes.floor import find_floors
from deux.scenes.ray_caster import RayCaster
from deux.scenes.scene_floors import SceneFloors

ROBOT = Robot()


@pytest.fixture
def scene_of(mesh_of, request):
    """A function from trimesh's meshes to a scene, with the floors that are found in it; named after the test."""

    def make(*parts):
        mesh = mesh_of(*parts)
        return Scene(request.node.name, mesh, find_floors(mesh), "test")

    return make


def chosen(scene, robot=ROBOT, **area):
    return SceneFloors(scene, SceneArea(**area), robot, RayCaster(scene.mesh))


def heights(floors):
    return [round(floor.height, 2) for floor in floors.floors]


@pytest.fixture
def tall_house(scene_of, two_storeys, slab):
    """Two storeys joined by stairs; a large cupboard takes room from the upper one."""
    return scene_of(*two_storeys(), slab([4, 2.9, 1], [7.8, 4.9, 4]))


def test_the_floor_with_the_most_room_is_taken_and_logged(tall_house, caplog):
    with caplog.at_level(logging.WARNING):
        floors = chosen(tall_house)
    assert heights(floors) == [0.0]
    (line,) = caplog.messages
    assert "has 2 floors, 0 at 0.00 m (" in line
    assert "1 at 2.90 m (" in line
    assert f"m2), of which {floors.free_space(0).area:.0f} m2 are free (scenes.floor=largest)." in line


def test_all_floors_and_a_floor_by_its_number(tall_house, caplog):
    assert sorted(heights(chosen(tall_house, floor="all"))) == [0.0, 2.9]
    with caplog.at_level(logging.WARNING):
        upper = chosen(tall_house, floor=1)
    assert "2 floors, 0 at 0.00 m" in caplog.text
    assert "the robot explores the floor at 2.90 m" in caplog.text
    assert heights(upper) == [2.9]
    assert upper.free_space(0).floor_height == pytest.approx(2.9)
    with pytest.raises(
        DeuxError,
        match=r"no floor 2: its floors, from the lowest, are 0 at 0.00 m \(\d+ m2\), 1 at 2.90 m \(\d+ m2\); choose",
    ):
        chosen(tall_house, floor=2)
    with pytest.raises(DeuxError, match=r"no floor 1: its floors are numbered 0 to 0, at 2.90 m"):
        upper.free_space(1)


def test_a_start_chooses_among_the_floors_where_it_is_free(tall_house):
    assert heights(chosen(tall_house, floor="all", start=(1.0, 5.2))) == [0.0], "upstairs it is open there"
    assert heights(chosen(tall_house, start=(4.5, 5.2))) == [2.9], "the upper end of the stairs"
    with pytest.raises(
        DeuxError, match=r"start x=20.00, z=0.00 is not on free floor: .*; the floors of the scene are 0 at"
    ):
        chosen(tall_house, start=(20.0, 0.0))


def test_a_region_bounds_every_floor(tall_house):
    floors = chosen(tall_house, floor="all", region=(0.0, 0.0, 3.0, 4.0))
    for number in range(2):
        space = floors.free_space(number)
        rows, columns = np.nonzero(space.free)
        x, z = space.frame.centre(int(rows.max()), int(columns.max()))
        assert x < 3.0
        assert z < 4.0


@pytest.mark.parametrize(
    ("area", "message"),
    [
        (
            {"start": (448_020.0, 5_411_001.0)},
            r"the start x=448020\.00, z=5411001\.00 .* point is x=44800\d\.\d+, z=54110",
        ),
        (
            {"region": (0.0, 0.0, 9.0, 9.0)},
            r"region \[0\.0, 0\.0, 9\.0, 9\.0\] .* from x=448000\.00, z=5411000\.00 to x=448008",
        ),
        (
            {"region": (448_003.0, 5_411_002.0, 448_004.0, 5_411_003.0)},
            r"height 1120\.00 m no place of the region \[448003\.0, ",
        ),
    ],
)
def test_places_are_named_in_the_world_however_far_the_mesh_is_from_its_origin(scene_of, house, slab, area, message):
    scene = scene_of(*house(), slab([2, 0, 1], [5, 1, 4]))
    x, y, z = origin = (448_000.0, 1120.0, 5_411_000.0)
    floors = tuple(replace(floor, height=floor.height + y) for floor in scene.floors)
    scene = replace(scene, mesh=replace(scene.mesh, origin=origin), floors=floors)
    assert chosen(scene, start=(x + 1.0, z + 1.0)).free_space(0).height_at(x + 1.0, z + 1.0) == pytest.approx(y)
    with pytest.raises(DeuxError, match=message):
        chosen(scene, **area).free_space(0)


def test_a_floor_is_surveyed_once(tall_house):
    floors = chosen(tall_house)
    assert floors.free_space(0) is floors.free_space(0)


@pytest.mark.parametrize(("climb", "area"), [(0.2, 24.0), (0.35, 40.0)])
def test_a_split_level_that_is_left_out_is_reported(scene_of, house, slab, caplog, climb, area):
    scene = scene_of(*house(), slab([5.0, 0, 0.2], [7.8, 0.3, 5.8]))
    with caplog.at_level(logging.WARNING):
        assert chosen(scene, Robot(max_climb=climb)).free_space(0).area == pytest.approx(area, rel=0.06)
    said = [message for message in caplog.messages if "a level 0.30 m higher of 14 m2 cannot be reached" in message]
    assert len(said) == (climb == 0.2)
    assert all("robot.max_climb is 0.2" in message for message in said)


def test_rooms_behind_closed_doors_and_floor_without_a_ceiling_are_reported(scene_of, house, slab, caplog):
    """A house of 7.4 x 5.4 m for the robot, parted at x = 5, with a terrace of 8 x 3 m before its open door."""
    parted, terrace = slab([5.0, 0, 0.2], [5.1, 2.6, 5.8]), slab([0, -0.2, -3], [8, 0, 0])
    with caplog.at_level(logging.WARNING):
        scene = scene_of(*house(door=True), parted, terrace)
        assert chosen(scene).free_space(0).area == pytest.approx(4.6 * 5.4, rel=0.05)
        (closed, outside) = caplog.messages
        assert "beside the 25 m2 of free space, 14 m2 cannot be reached, such as behind closed doors" in closed
        assert re.search(
            r", 2[23] m2 have no ceiling and are considered outdoors: include them by scenes\.region=", outside
        )
        caplog.clear()
        assert chosen(scene, region=(0, -3, 8, 6), start=(1.0, 1.0)).free_space(0).area > 45.0
        assert chosen(scene_of(*house())).free_space(0).area == pytest.approx(7.4 * 5.4, rel=0.05)
    assert caplog.messages == []


def test_a_house_on_a_large_ground_is_mapped_alone(scene_of, house, slab):
    scene = scene_of(*house(door=True), slab([-200, -0.5, -200], [200, -0.05, 200]))
    space = chosen(scene).free_space(0)
    assert space.area == pytest.approx(7.4 * 5.4, rel=0.04)
    assert space.frame.rows < 300


def test_a_scene_without_room_names_itself(scene_of, house, slab):
    scene = scene_of(*house(), slab([0.2, 0, 0.2], [7.8, 0.9, 5.8]))
    floors = SceneFloors(
        Scene(scene.name, scene.mesh, (*scene.floors,), "test"),
        SceneArea(),
        Robot(radius=4.0),
        RayCaster(scene.mesh),
    )
    with pytest.raises(DeuxError, match=f"{scene.name}: there is no floor to stand on"):
        floors.free_space(0)


@pytest.mark.parametrize("area", [{"floor": -1}, {"floor": "upper"}, {"region": (1.0, 0.0, 0.0, 1.0)}])
def test_areas_that_cannot_be_are_refused(area):
    with pytest.raises(DeuxError, match=r"scenes\.(floor|region) is"):
        SceneArea(**area)


def test_a_scene_in_millimetres_is_reported_before_its_floor_is_mapped(scene_of, house):
    scene = scene_of(*house())
    mesh = replace(scene.mesh, vertices=scene.mesh.vertices * np.float32(1000.0))
    with pytest.raises(DeuxError, match=r" m large, but a scene must be at most 250 m high: is its mesh in metres\?$"):
        SceneFloors(replace(scene, mesh=mesh), SceneArea(), ROBOT, RayCaster(mesh))
