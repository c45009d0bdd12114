from importlib.metadata import entry_points
from types import SimpleNamespace

import numpy as np
import pytest

from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.contracts import Action, Need
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.stratify import stratify
from deux.mapping.planning import distance_field
from deux.registry import registry
from deux.testing.box_world import Box, BoxWorld
from deux.testing.explorers import ExplorerSuite, run, two_rooms
from deux_plugins.explorers.oracle import OracleExplorer


class TestOracleExplorer(ExplorerSuite):
    def make_explorer(self):
        return OracleExplorer()


class TestOracleExplorerOfMoreTargetsThanCells(ExplorerSuite):
    def make_explorer(self):
        return OracleExplorer(targets=100, safety_margin=0.0)


def four_rooms():
    """Four rooms in a square, each with a doorway of 0.8 m to the next but for one pair; the robot in the first."""
    walls = (
        Box(2.95, 0.0, 3.05, 1.0), Box(2.95, 1.8, 3.05, 6.0),
        Box(0.0, 2.95, 2.0, 3.05), Box(2.8, 2.95, 3.05, 3.05), Box(3.05, 2.95, 4.0, 3.05), Box(4.8, 2.95, 6.0, 3.05),
    )  # fmt: skip
    world = BoxWorld(6.0, 6.0, walls, camera=Camera(8, 8))
    world.reset(1.5, 1.5, 0.0)
    return world


def travelled(explorer, world, steps, seed=0):
    """World (x, z) before each step, and how many steps touched something."""
    places, touched = [], []

    def note(observation):
        places.append(observation.pose[[0, 2], 3])
        touched.append(observation.collided)
        return observation

    run(explorer, world, steps, seed, note)
    return np.array(places), sum(touched)


def steps_until_all_are_visited(places, space, count):
    """Steps until the robot has been in each of `count` equal parts of the floor, or has arrived beside it."""
    steps = []
    for part in stratify(space.free, count):
        x = space.frame.origin_x + (part[:, 1] + 0.5) * space.frame.resolution
        z = space.frame.origin_z + (part[:, 0] + 0.5) * space.frame.resolution
        near = np.hypot(places[:, :1] - x, places[:, 1:] - z).min(axis=1) <= 0.2
        steps.append(int(np.argmax(near)) if near.any() else np.inf)
    return max(steps)


@pytest.mark.parametrize(("motion", "most_steps"), [("arcs", 400), ("turns", 350)])
@pytest.mark.parametrize("seed", range(2))
def test_visits_every_part_of_the_floor(seed, motion, most_steps):
    world = four_rooms()
    places, touched = travelled(OracleExplorer(targets=16, motion=motion), world, most_steps + 1, seed)
    assert steps_until_all_are_visited(places, world.free_space(), 16) < most_steps
    assert touched <= 4, "the paths keep their distance from walls"


def test_the_nearest_target_is_first():
    """In a corridor it goes from one end to the other without turning back."""
    world = BoxWorld(12.0, 0.8, camera=Camera(8, 8))
    world.reset(0.5, 0.4, 0.0)
    places, _ = travelled(OracleExplorer(), world, 400)
    end = int(np.argmax(places[:, 0] > 10.0))
    assert end > 0
    assert (np.maximum.accumulate(places[:end, 0]) - places[:end, 0]).max() < 0.5


@pytest.mark.parametrize("seed", [2, 3])
def test_its_way_to_a_target_is_a_shortest_path(seed):
    """From the first room to the last: until it is there, its way is not longer than the shortest to where it is.

    With turns on the spot; arcs go around corners in a curve, and are a little longer.
    """
    world = four_rooms()
    places, _ = travelled(OracleExplorer(targets=1, motion="turns"), world, 150, seed)
    space = world.free_space()
    distance = distance_field(space.free, space.frame.cell(*places[0])) * space.frame.resolution
    way = np.cumsum(np.hypot(*np.diff(places, axis=0).T))
    shortest = np.array([distance[space.frame.cell(*place)] for place in places[1:]])
    first_leg = np.logical_and.accumulate(way <= 1.05 * shortest + 0.1)
    assert shortest[first_leg].max() > 4.0


def test_the_floor_is_searched_once_for_each_target_and_not_at_each_step(monkeypatch):
    """A search takes as long as the floor is large."""
    searches = []

    def count(traversable, start):
        searches.append(start)
        return distance_field(traversable, start)

    monkeypatch.setattr("deux_plugins.explorers.oracle.distance_field", count)
    explorer, world = OracleExplorer(targets=4), four_rooms()
    travelled(explorer, world, 150)
    assert 2 <= len(searches) <= 12


def test_paths_keep_their_margin_where_there_is_room_for_it():
    """A passage that is wide enough for the margin beside one that is not: with the margin, and through the other."""
    walls = (Box(1.95, 0.0, 2.05, 1.0), Box(1.95, 1.27, 2.05, 2.4), Box(1.95, 3.2, 2.05, 4.0))
    for boxes, passage in ((walls, (2.4, 3.2)), ((*walls, Box(1.95, 2.4, 2.05, 3.2)), (1.0, 1.27))):
        world = BoxWorld(4.0, 4.0, boxes, camera=Camera(8, 8))
        world.reset(1.0, 1.1, 0.0)
        places, _ = travelled(OracleExplorer(targets=8), world, 250)
        crossing = np.flatnonzero(np.diff(places[:, 0] > 2.0))
        assert len(crossing) > 0
        assert ((places[crossing, 1] > passage[0]) & (places[crossing, 1] < passage[1])).all()


def test_new_targets_follow_the_last():
    world = BoxWorld(3.0, 3.0, camera=Camera(8, 8))
    places, _ = travelled(OracleExplorer(targets=2), world, 400)
    assert (np.ptp(places[200:], axis=0) > 1.0).all()


class RoomWithGlass(BoxWorld):
    """A room that a pane of glass divides, but for a passage at either end; the free floor knows nothing of it."""

    def free_space(self, floor=0):
        return BoxWorld(self.width, self.length).free_space()


@pytest.mark.parametrize("seed", range(3))
def test_a_target_that_it_cannot_come_to_does_not_hold_it(seed):
    world = RoomWithGlass(6.0, 4.0, (Box(2.9, 0.8, 3.0, 3.2),), camera=Camera(8, 8))
    world.reset(1.5, 2.0, 0.0)
    places, _ = travelled(OracleExplorer(), world, 500, seed)
    assert all(np.ptp(part, axis=0).max() > 1.0 for part in np.split(places, 2)), "it stayed for 250 steps"


def test_a_robot_beside_the_free_cells_sets_out_nevertheless():
    """The body is not on a grid: it may stand in a cell whose centre is too close to a wall."""
    world = BoxWorld(4.0, 4.0, camera=Camera(8, 8))
    world.reset(0.1, 0.1, 0.0)
    space = world.free_space()
    assert not space.free[0].any()
    places, _ = travelled(OracleExplorer(), world, 60)
    assert np.ptp(places, axis=0).max() > 1.0


SHIPPED = [entry.name for entry in entry_points(group="deux.explorers") if entry.value.startswith("deux_plugins.")]


def told(name, tmp_path):
    """The episode that the collector tells an explorer of that name; it does not have to act, some need weights."""
    episodes = []

    def make_explorer():
        explorer = registry().create("explorers", name, {})
        explorer.reset, explorer.act, explorer.map = episodes.append, lambda observation: Action.STOP, lambda: None
        return explorer

    plan = EpisodePlan(tmp_path / name, SimpleNamespace(name="rooms", identity="rooms"), 0, 1)
    measure = registry().create("uncertainties", "l1", {})
    explore(
        [plan],
        lambda scene: two_rooms(),
        make_explorer,
        lambda image, sparse, intrinsics: image[:, :1] + 1.0,
        uncertainty=measure,
    )
    return episodes[0]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_oracle_and_no_other_explorer_is_given_the_true_floor(name, tmp_path):
    assert (Need.FREE_SPACE in registry().create("explorers", name, {}).needs) == (name == "oracle")
    assert (told(name, tmp_path).free_space is not None) == (name == "oracle")


def test_figures_show_what_its_frames_saw():
    """A kept map would be drawn as explored (`deux.collection.explored_map`), and the oracle's was given."""
    explorer = OracleExplorer()
    run(explorer, two_rooms(), 5)
    assert explorer.map() is None


def test_an_unknown_motion_is_refused():
    with pytest.raises(DeuxError, match="sideways"):
        OracleExplorer(motion="sideways")


@pytest.mark.parametrize(("option", "value"), [("targets", 0), ("safety_margin", -1.0)])
def test_impossible_numbers_are_refused(option, value):
    with pytest.raises(DeuxError, match=f"{option} is {value}"):
        OracleExplorer(**{option: value})
