from collections import Counter

import numpy as np
import pytest

from deux.contracts import Action, Episode, Observation, Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.simulator.mesh_simulator import MeshSimulator
from deux.testing.box_world import Box, BoxWorld
from deux.testing.explorers import ExplorerSuite, run
from deux_plugins.explorers.random import RandomExplorer
from deux_plugins.scenes.apartments.source import reference

SMALL = Camera(8, 8)


class TestRandomExplorer(ExplorerSuite):
    def make_explorer(self):
        return RandomExplorer()


def test_is_uniform_over_the_three_moves_where_nothing_is_touched():
    actions = run(RandomExplorer(), BoxWorld(200.0, 200.0, camera=SMALL), 3000)
    counts = Counter(actions)
    assert set(counts) == {Action.FORWARD, Action.LEFT, Action.RIGHT}
    # The standard deviation of each count is 26.
    assert all(abs(count - 1000) < 110 for count in counts.values())


def test_goes_forward_more_often_when_told_to():
    counts = Counter(run(RandomExplorer(forward_probability=0.8), BoxWorld(500.0, 500.0, camera=SMALL), 2000))
    assert counts[Action.FORWARD] / 2000 == pytest.approx(0.8, abs=0.04)


LONGEST_STAY = 200
"""Steps within 0.3 m of one place after which the robot must have left it: a search to both sides takes 180."""


def longest_stay(world, steps, seed, forward_probability):
    """The most steps on end that the robot spends within 0.3 m of where it was at the first of them."""
    explorer = RandomExplorer(forward_probability)
    explorer.reset(Episode(seed, steps, world.camera, world.robot))
    places, collided, image = [], False, np.zeros((8, 8, 3), np.uint8)
    for step in range(steps):
        places.append(world.pose[[0, 2], 3])
        collided = world.step(explorer.act(Observation(step, world.pose, collided, image)))
    apart = np.linalg.norm(np.array(places)[:, None] - np.array(places), axis=-1)
    leaves = np.triu(apart > 0.3)
    leaves[:, -1] = True  # the end of the episode ends every stay
    return int((leaves.argmax(axis=1) - np.arange(steps)).max())


@pytest.mark.parametrize("forward_probability", [1.0 / 3.0, 0.9])
def test_does_not_stay_in_a_corner(forward_probability):
    for seed in range(5):
        world = BoxWorld(6.0, 6.0, camera=SMALL)
        world.reset(0.12, 0.12, np.pi / 4.0)
        assert longest_stay(world, 300, seed, forward_probability) < LONGEST_STAY / 2


@pytest.mark.parametrize("forward_probability", [1.0 / 3.0, 0.9])
def test_finds_the_gap_in_what_it_is_walled_in_by(forward_probability):
    """A pen of half a metre with a gap of 0.3 m, which random moves alone do not find in hundreds of steps."""
    fence = (
        Box(1.75, 1.65, 2.25, 1.75, 0.5), Box(1.75, 2.25, 2.25, 2.35, 0.5), Box(1.65, 1.65, 1.75, 2.35, 0.5),
        Box(2.25, 1.65, 2.35, 1.85, 0.5), Box(2.25, 2.15, 2.35, 2.35, 0.5),
    )  # fmt: skip
    for seed in range(10):
        world = BoxWorld(4.0, 4.0, fence, camera=SMALL)
        world.reset(2.0, 2.0, float(seed))
        assert longest_stay(world, 400, seed, forward_probability) < LONGEST_STAY


@pytest.mark.parametrize("flat_seed", [200002, 200015])
def test_does_not_stay_in_the_tight_places_of_a_generated_flat(flat_seed):
    """It starts in doorways, corners and niches: on the sixth of the floor that is closest to obstacles."""
    simulator = MeshSimulator(reference(flat_seed), SMALL, Robot())
    space = simulator.free_space()
    clearance = np.where(space.free, space.clearance, np.inf)
    tight = np.argwhere(clearance <= np.quantile(clearance[space.free], 1.0 / 6.0))
    rng = np.random.default_rng(0)
    for seed in range(8):
        simulator.reset(*space.frame.centre(*rng.choice(tight)), rng.uniform(-np.pi, np.pi))
        assert longest_stay(simulator, 400, seed, 1.0 / 3.0) < LONGEST_STAY


def test_survives_where_there_is_no_way_out():
    side = 2.0 * Robot().radius + 0.02
    assert longest_stay(BoxWorld(side, side, camera=SMALL), 400, 0, 1.0 / 3.0) == 399


def test_an_impossible_probability_is_refused():
    with pytest.raises(DeuxError, match=r"forward_probability is 1\.5"):
        RandomExplorer(forward_probability=1.5)
