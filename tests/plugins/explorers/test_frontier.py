from dataclasses import replace

import cv2
import numpy as np
import pytest

from deux.contracts import Action, Need, Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import yaw_of
from deux.simulator.mesh_simulator import MeshSimulator
from deux.simulator.starts import random_starts
from deux.testing.box_world import Box, BoxWorld
from deux.testing.explorers import ExplorerSuite, run
from deux_plugins.explorers.frontier import FrontierExplorer
from deux_plugins.scenes.apartments.source import reference


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
    x = space.frame.origin_x + (columns + 0.5) * space.frame.resolution
    z = space.frame.origin_z + (rows + 0.5) * space.frame.resolution
    known = explorer.map()
    rows, columns = known.frame.cells(x, z)
    inside = known.frame.contains(rows, columns)
    return np.count_nonzero(known.occupancy[rows[inside], columns[inside]] == 2) / len(x)


@pytest.mark.parametrize(("choose", "steps"), [("nearest", 500), ("largest", 700)])
def test_sees_at_least_95_percent_of_four_rooms(choose, steps):
    explorer, world = FrontierExplorer(choose=choose), four_rooms()
    run(explorer, world, steps)
    assert covered(explorer, world) >= 0.95


@pytest.mark.parametrize(("seed", "steps"), [(200187, 300), (200015, 600), (200024, 750)])
def test_sees_at_least_95_percent_of_a_generated_flat(seed, steps):
    """The first start lies at the end of a frontier, which is a trap; the third flat is large, 49 square metres."""
    simulator = MeshSimulator(reference(seed), Camera(64, 64), Robot())
    simulator.reset(*random_starts(simulator.free_space(), 1, np.random.default_rng(seed))[0])
    explorer = FrontierExplorer()
    run(explorer, simulator, steps, seed)
    assert covered(explorer, simulator) >= 0.95


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_passes_where_the_robot_fits_without_its_margin(side):
    """A passage of 0.27 m for a robot of 0.2 m; the frontier in the other room is out of sight from the first."""
    walls = (Box(2.45, 0.0, 2.55, 2.0), Box(2.45, 2.27, 2.55, 4.0))
    world = BoxWorld(5.0, 4.0, walls)
    world.reset(2.5 + side, 1.0, 0.0)
    explorer = FrontierExplorer()
    run(explorer, world, 250)
    assert covered(explorer, world) >= 0.95


def targets(explorer, world, steps, change=lambda observation: observation):
    """The frontier cells that are targets, world (x, z), in order of time."""
    chosen = []

    def note(observation):
        if explorer.frontier is not None and (not chosen or chosen[-1] != explorer.frontier):
            chosen.append(explorer.frontier)
        return change(observation)

    run(explorer, world, steps, change=note)
    return np.array(chosen)


def depth_errors(seed):
    """Smooth errors of 15 %, new ones in each frame: they make frontiers come and go."""
    rng = np.random.default_rng(seed)

    def change(observation):
        depth = observation.predicted_depth
        factor = cv2.resize(1.0 + 0.15 * rng.standard_normal((5, 5)), depth.shape[::-1])
        return replace(observation, predicted_depth=(depth * factor.clip(0.5, 1.5)).astype(np.float32))

    return change


@pytest.mark.parametrize("options", [{}, {"choose": "largest"}, {"depth": "predicted"}])
def test_never_goes_to_and_fro_between_two_targets(options):
    change = {"change": depth_errors(0)} if options.get("depth") == "predicted" else {}
    chosen = targets(FrontierExplorer(**options), four_rooms(), 500, **change)
    assert len(chosen) > 15
    assert len(np.unique(chosen, axis=0)) == len(chosen), "a frontier cell was a target twice"
    again = np.hypot(*(chosen[2:] - chosen[:-2]).T) < 0.3
    assert not (again[:-1] & again[1:]).any(), "two targets took turns"


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

    def render(self, poses, channels):
        return BoxWorld(6.0, 4.0).render(poses, channels)


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


@pytest.mark.parametrize("choose", ["nearest", "largest"])
def test_near_frontiers_are_left_aside_whichever_is_chosen(choose, monkeypatch):
    """Of the frontiers at each choice, those of 1.5 m and more where there are any of some size."""
    explorer = FrontierExplorer(choose=choose, least_way=1.5)
    spared, preferred, chosen = [], explorer.preferred_frontiers, explorer.frontier_target

    def recorded(candidates, index):
        kept = preferred(candidates)
        if len(kept) < len(candidates) or (kept.lengths * explorer.occupancy.resolution >= 1.5).all():
            spared.append(candidates.lengths[index] * explorer.occupancy.resolution)
        return chosen(candidates, index)

    monkeypatch.setattr(explorer, "frontier_target", recorded)
    run(explorer, four_rooms(), 200)
    assert len(spared) >= 3
    assert min(spared) >= 1.5
