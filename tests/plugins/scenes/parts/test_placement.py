"""Furniture must keep clear of walls, doorways, windows and other furniture."""

import pytest

from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.floor_plan import FloorPlan, Opening, Room
from deux_plugins.scenes.parts.mesh_builder import NORTH, MeshBuilder, Placement
from deux_plugins.scenes.parts.placement import RoomSpace
from deux_plugins.scenes.parts.shapes import Model

# Two rooms of 4 m x 3 m, joined at x = 4.1, and a window in the first room's wall at z = 0.05.
PLAN = FloorPlan(
    rooms=(Room("study", 0.05, 0.05, 4.05, 3.05, 2.5), Room("bedroom", 4.15, 0.05, 8.15, 3.05, 2.5)),
    doors=(Opening("z", 4.1, 1.0, 1.9, 0.0, 2.05, (0, 1)),),
    windows=(Opening("x", 0.05, 1.5, 2.5, 0.9, 2.1, (0,)),),
    entrance=0,
)


@pytest.fixture
def space() -> RoomSpace:
    return RoomSpace(PLAN, 0, MeshBuilder(), Draws(0, "test"))


def test_furniture_stays_inside_the_room(space: RoomSpace):
    assert space.place(Model("table", 1.0, 0.5, 0.7), Placement(3.8, 2.0)) is None
    assert space.place(Model("table", 1.0, 0.5, 0.7), Placement(2.0, 2.3)) is not None


def test_furniture_does_not_overlap(space: RoomSpace):
    assert space.place(Model("table", 1.0, 0.5, 0.7), Placement(1.0, 1.5)) is not None
    assert space.place(Model("chair", 0.4, 0.4, 0.9), Placement(1.3, 1.7)) is None
    assert space.place(Model("shelf", 0.4, 0.2, 0.3), Placement(1.0, 1.6, y=1.4)) is not None


def test_a_chair_may_be_pushed_under_its_own_table_only(space: RoomSpace):
    table = space.place(Model("table", 1.0, 0.8, 0.7), Placement(1.0, 0.8))
    chair = Model("chair", 0.4, 0.4, 0.9)
    pushed = Placement(1.0, 1.9, NORTH)
    assert space.place(chair, pushed) is None
    assert space.place(chair, pushed, ignoring=Placement(3.0, 0.8)) is None
    assert space.place(chair, pushed, ignoring=table) == pushed


def test_doorways_stay_free(space: RoomSpace):
    assert space.place(Model("plant", 0.3, 0.3, 0.5), Placement(3.7, 1.3)) is None


def test_only_low_furniture_stands_at_a_window(space: RoomSpace):
    assert space.place(Model("wardrobe", 1.0, 0.5, 2.0), Placement(2.0, 0.08)) is None
    assert space.place(Model("radiator", 0.8, 0.12, 0.66), Placement(2.0, 0.08)) is not None


def test_what_must_open_keeps_its_front_free(space: RoomSpace):
    assert space.place(Model("stool", 0.3, 0.3, 0.4), Placement(0.5, 0.9)) is not None
    assert space.place(Model("wardrobe", 0.8, 0.5, 2.0, front=0.5), Placement(0.5, 0.08)) is None
    assert space.place(Model("wardrobe", 0.8, 0.5, 2.0, front=0.2), Placement(0.5, 0.08)) is not None
    assert space.place(Model("stool", 0.3, 0.3, 0.4), Placement(0.5, 0.5)) is None


def test_a_room_is_never_cut_in_two(space: RoomSpace):
    assert space.place(Model("counter", 3.9, 0.5, 0.9), Placement(2.02, 1.9)) is None
    assert space.place(Model("counter", 2.0, 0.5, 0.9), Placement(1.1, 1.9)) is not None


def test_rugs_lie_under_furniture_but_not_on_each_other(space: RoomSpace):
    assert space.place(Model("table", 1.0, 0.5, 0.7), Placement(1.5, 1.5)) is not None
    assert space.lay(Model("rug", 1.5, 1.0, 0.01), Placement(1.5, 1.2)) is not None
    assert space.lay(Model("rug", 1.0, 1.0, 0.01), Placement(2.0, 1.2)) is None


def test_against_wall_backs_onto_a_wall(space: RoomSpace):
    model = Model("shelf", 0.8, 0.3, 1.8)
    placed = space.against_wall(model)
    assert placed is not None
    room = space.room
    gaps = (placed.x - room.x0, room.x1 - placed.x, placed.z - room.z0, room.z1 - placed.z)
    assert min(gaps) == pytest.approx(0.025)
