import numpy as np
import pytest

from deux.contracts import Action, Need
from deux.errors import DeuxError
from deux.geometry.poses import yaw_of
from deux.testing.box_world import Box, BoxWorld
from deux.testing.explorers import ExplorerSuite, run
from deux_plugins.explorers.frontier import FrontierExplorer


class TestFrontierExplorer(ExplorerSuite):
    def make_explorer(self):
        return FrontierExplorer()


class TestFrontierExplorerOfTheLargest(ExplorerSuite):
    def make_explorer(self):
        return FrontierExplorer(depth="predicted", choose="largest")


def four_rooms():
    """Four rooms of unequal size joined by doorways of 0.8 to 1 m, with furniture; the robot in the first."""
    walls = (
        Box(3.95, 0.0, 4.05, 2.0), Box(3.95, 3.0, 4.05, 5.9), Box(3.95, 6.8, 4.05, 8.0),
        Box(0.0, 3.95, 1.5, 4.05), Box(2.4, 3.95, 3.95, 4.05),
        Box(4.05, 4.95, 6.0, 5.05), Box(6.8, 4.95, 9.0, 5.05),
    )  # fmt: skip
    furniture = (Box(0.5, 0.5, 1.5, 1.2, 0.5), Box(6.0, 2.0, 7.0, 3.0, 0.75), Box(1.0, 6.0, 2.0, 7.0, 0.4))
    world = BoxWorld(9.0, 8.0, walls + furniture)
    world.reset(2.0, 2.0, 0.3)
    return world


def covered(explorer, world):
    """Share of the floor that can be reached which the explorer's map knows to be free."""
    space = world.free_space()
    rows, columns = np.nonzero(space.free)
    x = (columns + 0.5) * space.frame.resolution
    z = (rows + 0.5) * space.frame.resolution
    known = explorer.map()
    rows, columns = known.frame.cells(x, z)
    inside = known.frame.contains(rows, columns)
    return np.count_nonzero(known.occupancy[rows[inside], columns[inside]] == 2) / len(x)


@pytest.mark.parametrize(("choose", "steps"), [("nearest", 500), ("largest", 700)])
def test_sees_at_least_95_percent_of_four_rooms(choose, steps):
    explorer, world = FrontierExplorer(choose=choose), four_rooms()
    run(explorer, world, steps)
    assert covered(explorer, world) >= 0.95


def test_goes_on_to_new_places_when_everything_is_known():
    explorer, world = FrontierExplorer(), BoxWorld(3.0, 3.0)
    places = []

    def note(observation):
        places.append(observation.pose[[0, 2], 3])
        return observation

    run(explorer, world, 300, change=note)
    spread = np.ptp(np.array(places[150:]), axis=0)
    assert (spread > 1.0).all()


def test_never_swings_left_and_right_on_the_spot():
    actions = run(FrontierExplorer(), four_rooms(), 250)
    swings = {(Action.LEFT, Action.RIGHT, Action.LEFT), (Action.RIGHT, Action.LEFT, Action.RIGHT)}
    found = sum(window in swings for window in zip(actions, actions[1:], actions[2:], strict=False))
    assert found <= 4


def test_looks_round_a_small_place_instead_of_walking():
    """All of a closet is seen by turning: the first look must go all the way round."""
    explorer, world = FrontierExplorer(), BoxWorld(2.0, 2.0)
    headings = []

    def note(observation):
        headings.append(yaw_of(observation.pose))
        return observation

    run(explorer, world, 80, change=note)
    assert np.ptp(np.unwrap(headings)) > np.pi
    assert covered(explorer, world) >= 0.95


class RoomWithGlass(BoxWorld):
    """A room that a pane of glass divides but for a passage at either end: the body meets it, the depth does not."""

    def __init__(self):
        super().__init__(6.0, 4.0, (Box(2.9, 1.0, 3.0, 3.0),))
        self.what_is_seen = BoxWorld(6.0, 4.0)

    def observe(self, labels=False):
        self.what_is_seen.reset(self.pose[0, 3], self.pose[2, 3], yaw_of(self.pose))
        return self.what_is_seen.observe(labels)


def test_an_obstacle_that_no_camera_sees_does_not_hold_it():
    world = RoomWithGlass()
    world.reset(1.5, 2.0, -np.pi / 2.0)
    x_of_steps = []

    def note(observation):
        x_of_steps.append(observation.pose[0, 3])
        return observation

    run(FrontierExplorer(), world, 300, change=note)
    assert max(x_of_steps) > 4.0


def test_needs_follow_the_depth_source():
    assert FrontierExplorer().needs == {Need.SENSOR_DEPTH}
    assert FrontierExplorer(depth="predicted").needs == {Need.PREDICTED_DEPTH}


@pytest.mark.parametrize("options", [{"depth": "lidar"}, {"choose": "farthest"}])
def test_unknown_options_are_refused(options):
    with pytest.raises(DeuxError, match=next(iter(options.values()))):
        FrontierExplorer(**options)
