from collections import Counter

import numpy as np
import pytest

from deux.contracts import Action
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.testing.box_world import BoxWorld
from deux.testing.explorers import ExplorerSuite, run
from deux_plugins.explorers.random import RandomExplorer

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


def test_frees_itself_from_a_corner():
    for seed in range(5):
        world = BoxWorld(6.0, 6.0)
        world.reset(0.12, 0.12, np.pi / 4.0)
        run(RandomExplorer(forward_probability=0.9), world, 60, seed)
        assert np.hypot(*(world.pose[[0, 2], 3] - 0.12)) > 1.0


def test_an_impossible_probability_is_refused():
    with pytest.raises(DeuxError, match=r"forward_probability is 1\.5"):
        RandomExplorer(forward_probability=1.5)
