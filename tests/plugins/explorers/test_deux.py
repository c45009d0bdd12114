from dataclasses import replace

import cv2
import numpy as np
import pytest

from deux.configuration import compose
from deux.contracts import Episode, Need, Robot
from deux.errors import DeuxError
from deux.log_once import warn_once
from deux.mapping.frontier_targets import cell_centres
from deux.mapping.occupancy import FREE
from deux.testing.box_world import Box, BoxWorld
from deux.testing.explorers import ExplorerSuite, observe, run, two_rooms
from deux_plugins.explorers.deux import DeuxExplorer

PAPER = {option: value for option, value in compose(["explore=deux_paper"]).explore.items() if option != "name"}
"""The options of conf/explore/deux_paper.yaml."""


class TestDeuxExplorer(ExplorerSuite):
    def make_explorer(self):
        return DeuxExplorer()


class TestDeuxExplorerAsInThePaper(ExplorerSuite):
    def make_explorer(self):
        return DeuxExplorer(**PAPER)


class TestDeuxExplorerOfTheSensorsDepth(ExplorerSuite):
    def make_explorer(self):
        return DeuxExplorer(map_depth="sensor", target="greedy")


class TestDeuxExplorerWithTargetsOnFrontiers(ExplorerSuite):
    def make_explorer(self):
        return DeuxExplorer(target="sampled")


def share_of_time_on_the_left(explorer, uncertain_side, seed):
    """Run in an empty symmetric room where one half is hard for the depth model; the robot starts in the middle."""
    world = BoxWorld(10.0, 3.0)
    rays = world.camera.rays()
    x_of_steps = []

    def residual_by_place(observation):
        x = observation.pose[0, 3]
        x_of_steps.append(x)
        surface = x + (rays @ observation.pose[0, :3]) * observation.predicted_depth
        side = -1.0 if uncertain_side == "left" else 1.0
        residual = np.where(side * (surface - 5.0) > 0.0, 0.2, 0.02).astype(np.float32)
        residual[observation.predicted_depth == 0.0] = np.nan
        mean = np.nanmean(residual)
        return replace(observation, residual=residual, uncertainty=1.0 - float(np.exp(-mean)))

    run(explorer, world, 350, seed, residual_by_place)
    return np.mean(np.array(x_of_steps) < 5.0)


@pytest.mark.parametrize(
    ("options", "seeds", "least"),
    [
        ({}, 1, 0.35),
        pytest.param({"residual_pose": "pose"}, 3, 0.15, marks=pytest.mark.slow),
        ({"target": "sampled", "max_range": 3.0}, 3, 0.3),  # with 5 m, all of the room is soon known
        (PAPER, 3, 0.15),
    ],
    ids=["default", "at poses", "on frontiers", "paper"],
)
def test_prefers_the_uncertain_side_of_a_symmetric_room(options, seeds, least):
    """The share of an episode differs from seed to seed by a standard deviation of 0.08."""
    shares = {
        side: [share_of_time_on_the_left(DeuxExplorer(**options), side, seed) for seed in range(seeds)]
        for side in ("left", "right")
    }
    assert np.mean(shares["left"]) - np.mean(shares["right"]) > least


def six_rooms():
    """Three rooms of 4 x 3.7 m on either side of a corridor, each with a doorway of 1 m; the robot in the corridor."""
    walls = [Box(x - 0.05, z, x + 0.05, z + 3.7) for x in (4.0, 8.0) for z in (0.0, 5.3)]
    for z in (3.7, 5.3):
        ends = (0.0, 1.5, 2.5, 5.5, 6.5, 9.5, 10.5, 12.0)
        walls += [Box(x0, z - 0.05, x1, z + 0.05) for x0, x1 in zip(ends[::2], ends[1::2], strict=True)]
    world = BoxWorld(12.0, 9.0, tuple(walls))
    world.reset(6.0, 4.5, 0.0)
    return world


def share_of_hard_pixels(explorer, hard, seed, contrast=2.0):
    """Mean share of a frame's pixels that show one of two sets of rooms, where the residual is higher by `contrast`.

    The sets alternate like the squares of a chessboard; the corridor is shared between them.
    """
    world = six_rooms()
    rays = world.camera.rays()
    shares = []

    def residual_by_room(observation):
        depth = observation.predicted_depth - 0.1  # what belongs to a room's wall is in front of it
        x, z = (observation.pose[axis, 3] + (rays @ observation.pose[axis, :3]) * depth for axis in (0, 2))
        shown = (np.floor(x / 4.0) + (z > 4.5)) % 2 == hard
        shares.append(shown.mean())
        residual = ((0.02 + 0.02 * depth) * np.where(shown, contrast, 1.0)).astype(np.float32)
        return replace(observation, residual=residual, uncertainty=1.0 - float(np.exp(-residual.mean())))

    run(explorer, world, 150, seed, residual_by_room)
    return np.mean(shares)


@pytest.mark.parametrize(("target", "contrast", "least"), [("sampled", 2.0, 0.6), ("informative", 4.0, 0.54)])
def test_its_frames_show_the_uncertain_rooms(target, contrast, least):
    """One that does not see the difference has exactly 0.5: what it shows of one set and of the other adds up to 1.

    Informative targets weigh novelty too: over six seeds, their mean is 0.52 at a contrast of 2 and 0.58 at 4.
    """
    explorer = DeuxExplorer(target=target, max_incidence=90.0)  # exact depth has no ramps
    shares = [share_of_hard_pixels(explorer, hard, seed, contrast) for hard in (0, 1) for seed in range(2)]
    assert np.mean(shares) > least


class Noting(DeuxExplorer):
    """Notes how far each frontier that it chose was, as a share of the mean over those that it chose from."""

    def choose_target(self, pose, candidates, distance):
        target = super().choose_target(pose, candidates, distance)
        if len(candidates) > 0:
            places = cell_centres(self.occupancy.frame, self.preferred_frontiers(candidates).places)
            ways = np.hypot(*(places - pose[[0, 2], 3]).T)
            self.shares.append(np.hypot(*(np.array(target.place) - pose[[0, 2], 3])) / ways.mean())
        return target


def test_divided_by_actions_nearer_frontiers_are_drawn():
    means = {}
    for per_action in (False, True):
        explorer = Noting("constant", "sensor", "sampled", 0.05, max_range=2.0, least_way=0.0, per_action=per_action)
        explorer.shares = []
        for seed in range(3):
            corridor = BoxWorld(12.0, 3.0)
            corridor.reset(6.0, 1.5, 0.0)
            run(explorer, corridor, 100, seed)
        means[per_action] = np.mean(explorer.shares)
    assert means[True] < means[False] - 0.1


def test_high_temperature_forgets_the_uncertainty():
    """Almost uniform draws: both sides of the room get their part of the time."""
    explorer = DeuxExplorer(target="sampled", temperature=1e6)
    shares = [share_of_time_on_the_left(explorer, "left", seed) for seed in range(4)]
    assert 0.3 < np.mean(shares) < 0.7


@pytest.mark.parametrize("target", ["informative", "sampled", "greedy"])
def test_a_constant_uncertainty_knows_no_sides(target):
    shares = {
        side: share_of_time_on_the_left(DeuxExplorer("constant", target=target), side, seed=0)
        for side in ("left", "right")
    }
    assert shares["left"] == shares["right"]


def test_its_tolerance_follows_the_depth_that_it_maps():
    def measured(observation):
        return replace(observation, depth_error=0.07)

    for depth, error in (("predicted", 0.07), ("sensor", 0.0)):
        same = DeuxExplorer(map_depth=depth), DeuxExplorer(map_depth=depth, depth_error=error)
        assert run(same[0], two_rooms(), 80, 0, measured) == run(same[1], two_rooms(), 80, 0, measured)
        np.testing.assert_array_equal(*(explorer.occupancy.cells for explorer in same))


def test_its_map_allows_for_the_mean_of_the_errors_measured_lately():
    explorer = DeuxExplorer()
    explorer.reset(Episode(0, 100, two_rooms().camera, Robot()))
    seen = observe(two_rooms(), explorer.needs, 0, False)

    def allowed(error):
        return explorer.depth_error(replace(seen, depth_error=error))

    assert allowed(np.nan) is None
    assert allowed(0.1) == pytest.approx(0.1)
    assert allowed(0.0) == pytest.approx(0.05)
    assert allowed(np.nan) == pytest.approx(0.05)
    assert [allowed(0.02) for _ in range(20)][-1] == pytest.approx(0.02)
    assert [allowed(9.0) for _ in range(20)][-1] == 0.2


def test_its_fingerprint_contains_what_the_map_allows_for():
    assert DeuxExplorer().fingerprint() != DeuxExplorer(depth_error=0.1).fingerprint()
    assert DeuxExplorer(depth_error=0.1).fingerprint() == DeuxExplorer(map_depth="sensor").fingerprint()


def test_a_limit_of_incidence_reaches_its_map_of_predicted_depth():
    for depth, incidence in (("predicted", 75.0), ("sensor", 90.0)):
        explorer = DeuxExplorer(map_depth=depth, max_incidence=75.0)
        explorer.reset(Episode(0, 100, two_rooms().camera, Robot()))
        assert explorer.occupancy.errors.incidence == incidence
    with pytest.raises(DeuxError, match=r"explore\.max_incidence .*90"):
        DeuxExplorer(max_incidence=91.0)


def test_floor_that_it_has_been_on_stays_free_on_its_map_of_predicted_depth_only():
    for depth, option, expected in (("predicted", True, True), ("predicted", False, False), ("sensor", True, False)):
        explorer = DeuxExplorer(map_depth=depth, visited_is_free=option)
        explorer.reset(Episode(0, 100, two_rooms().camera, Robot()))
        assert explorer.occupancy.errors.visited_is_free == expected


def test_a_floor_that_is_lifted_by_wrong_depth_confines_it_unless_its_map_allows_for_that():
    def lifted(observation):
        return replace(observation, predicted_depth=0.8 * observation.predicted_depth)

    def free(depth_error):
        explorer = DeuxExplorer(depth_error=depth_error)
        run(explorer, two_rooms(), 60, 0, lifted)
        return (explorer.occupancy.cells == FREE).sum()

    assert free(0.1) > 2 * free(0.0)


def test_informative_targets_explore_both_rooms():
    x = []

    def watched(observation):
        x.append(observation.pose[0, 3])
        return observation

    run(DeuxExplorer(), two_rooms(), 200, 0, watched)
    assert min(x) < 2.5
    assert max(x) > 3.5


@pytest.mark.parametrize("residual_pose", ["pose", "surface"])
def test_its_map_shows_the_uncertainty_that_it_recorded(residual_pose):
    explorer = DeuxExplorer(residual_pose)
    run(explorer, two_rooms(), 60)
    known = explorer.map()
    assert known.uncertainty is not None
    recorded = known.uncertainty[np.isfinite(known.uncertainty)]
    assert recorded.size > 100
    assert recorded.min() >= 1.0 - np.exp(-0.02) - 1e-6
    assert recorded.max() <= 1.0 - np.exp(-0.1) + 1e-6


def places_visited(distort, seed, steps=200):
    """Number of half-metre squares of the two rooms that the robot comes to, with distorted predicted depth."""
    places = set()

    def predicted(observation):
        places.add(tuple(np.floor(observation.pose[[0, 2], 3] / 0.5)))
        depth, truth = distort(observation.predicted_depth).astype(np.float32), observation.predicted_depth
        error = float(np.median(np.abs(depth - truth)[truth > 0] / truth[truth > 0]))
        return replace(observation, predicted_depth=depth, depth_error=error)

    run(DeuxExplorer(), two_rooms(), steps, seed, predicted)
    return len(places)


@pytest.mark.parametrize("seed", range(3))
def test_smooth_depth_errors_of_20_percent_do_not_imprison_it(seed):
    rng = np.random.default_rng(seed)

    def distort(depth):
        factor = 1.0 + cv2.resize(rng.uniform(-0.2, 0.2, (4, 4)), depth.shape[::-1], interpolation=cv2.INTER_LINEAR)
        wrong = 0.4 * depth
        wrong[6:-6, 6:-6] = (factor * depth)[6:-6, 6:-6]
        return wrong

    assert places_visited(distort, seed) >= 15


@pytest.mark.parametrize("seed", range(3))
def test_it_gets_about_even_if_the_depth_is_hopeless(seed):
    """All of the floor looks like an obstacle."""
    assert places_visited(lambda depth: 0.5 * depth, seed, steps=300) >= 10


def test_its_uncertainty_is_shown_only_where_the_map_is_known():
    explorer = DeuxExplorer()
    run(explorer, two_rooms(), 60)
    known = explorer.map()
    assert np.isnan(known.uncertainty[known.occupancy == 0]).all()


def test_needs_follow_the_options():
    assert DeuxExplorer().needs == {Need.PREDICTED_DEPTH, Need.RESIDUAL}
    assert DeuxExplorer(map_depth="sensor").needs == {Need.SENSOR_DEPTH, Need.RESIDUAL}


@pytest.mark.parametrize(
    "options",
    [
        {"residual_pose": "ray"},
        {"map_depth": "lidar"},
        {"target": "best"},
        {"temperature": 0.0},
        {"temperature": float("nan")},
        {"resolution": 0.0},
        {"resolution": 1.5},
        {"max_range": -3.0},
        {"max_range": float("inf")},
        {"safety_margin": -0.2},
        {"safety_margin": float("nan")},
        {"guidance": -1.0},
        {"view_guidance": -0.5},
        {"least_way": -1.0},
        {"depth_error": -0.1},
        {"motion": "sideways"},
    ],
)
def test_unknown_options_are_refused(options):
    option, value = next(iter(options.items()))
    with pytest.raises(DeuxError, match=f"{option} .*{value}"):
        DeuxExplorer(**options)


@pytest.mark.parametrize(
    ("target", "option", "value"),
    [
        ("informative", "temperature", 0.3),
        ("informative", "guidance", 1.25),
        ("informative", "least_way", 0.75),
        ("informative", "keep_targets", True),
        ("sampled", "view_guidance", 0.7),
        ("sampled", "revisits", False),
        ("greedy", "on_the_way", False),
        ("greedy", "temperature", 0.35),
    ],
)
def test_an_option_of_other_targets_is_reported(target, option, value, caplog):
    warn_once.cache_clear()
    DeuxExplorer(target=target, **{option: value})
    assert caplog.messages == [f"explore.{option}={value} has no effect with explore.target={target}."]


@pytest.mark.parametrize(
    "options",
    [{}, {"revisits": False}, {"target": "sampled", "temperature": 0.45}, {"target": "greedy", "least_way": 0.85}],
)
def test_an_option_of_the_chosen_targets_is_not_reported(options, caplog):
    warn_once.cache_clear()
    DeuxExplorer(**options)
    assert caplog.messages == []
