"""Conformance suite for learned explorers: the suite for explorers with the shipped policy, and additional tests.

A plugin's test file subclasses it, and pytest runs the whole suite:

    class TestMyExplorer(LearnedExplorerSuite):
        explorer_class = MyExplorer
"""

from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch

from deux.contracts import Action, Explorer, Need
from deux.environment.egocentric import Crops
from deux.environment.memory import RESOLUTION
from deux.geometry.camera import Camera
from deux.policies.learned_explorer import LearnedExplorer
from deux.policies.network import PolicyNetwork
from deux.policies.policy_files import TrainedPolicy, load_policy, save_policy
from deux.registry import registry
from deux.testing.box_world import Box, BoxWorld
from deux.testing.explorers import ExplorerSuite, run, two_rooms


def untrained_policy(crops: Crops | None = None, seed: int = 0) -> TrainedPolicy:
    """Create a policy with random initial weights, which acts almost randomly."""
    crops = crops or Crops()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = PolicyNetwork(crops.pixels)
    return TrainedPolicy(network.eval(), crops, RESOLUTION, {}, {"reward": "none"})


class LearnedExplorerSuite(ExplorerSuite):
    """Base class of the tests of a learned explorer. Subclasses define `explorer_class`.

    Tests with the policy that ships with the explorer are skipped if its file is missing.
    """

    explorer_class: ClassVar[type[LearnedExplorer]]

    steps = 30

    def make_explorer(self) -> Explorer:
        """Create the explorer with its shipped policy."""
        return self.explorer_class(str(self.shipped_policy()))

    def shipped_policy(self) -> Path:
        """Path of the policy file that ships with the explorer; skips the test if it is missing."""
        path = self.explorer_class.shipped_weights
        if not path.is_file():
            pytest.skip(f"there is no {path.name} in {path.parent}: task=train_explorer makes one")
        return path

    def test_its_reward_is_installed(self) -> None:
        """The explorer's `reward` is a registered plugin."""
        assert self.explorer_class.reward in registry().names("rewards")

    def test_it_needs_the_sensors_depth_alone(self) -> None:
        """The explorer needs sensor depth only, since the data that its reward needs are only used in training."""
        assert self.explorer_class("anything").needs == {Need.SENSOR_DEPTH}

    def test_the_shipped_policy_is_trained_for_its_reward(self) -> None:
        """The header of the policy file contains the explorer's reward and the learning curve."""
        policy = load_policy(self.shipped_policy())
        assert policy.made_by["reward"] == self.explorer_class.reward
        assert policy.made_by["curve"]["steps"]

    def test_the_shipped_policy_gets_about(self, tmp_path: Path) -> None:
        """The shipped policy explores more than 1.5 times the area of an untrained one in three rooms."""
        untrained = tmp_path / "untrained.safetensors"
        save_policy(untrained, untrained_policy())
        areas = {
            path: sum(_area_seen(self.explorer_class(str(path)), seed) for seed in range(2))
            for path in (self.shipped_policy(), untrained)
        }
        assert areas[self.shipped_policy()] > 1.5 * areas[untrained], "the area seen, in square metres"

    def test_another_policy_is_used_if_it_is_named(self, tmp_path: Path) -> None:
        """The explorer takes another policy file. Its actions depend on the episode's seed unless it is greedy."""
        path = tmp_path / "policy.safetensors"
        save_policy(path, untrained_policy())
        actions = run(self.explorer_class(str(path)), two_rooms(), self.steps, seed=1)
        assert set(actions) == {Action.FORWARD, Action.LEFT, Action.RIGHT}, "an untrained policy does everything"
        assert run(self.explorer_class(str(path)), two_rooms(), self.steps, seed=2) != actions
        greedy = [run(self.explorer_class(str(path), greedy=True), two_rooms(), self.steps, seed=s) for s in (1, 2)]
        assert greedy[0] == greedy[1]


def _area_seen(explorer: Explorer, seed: int) -> float:
    """Area of the map of three rooms after 60 steps in square metres."""
    walls = [Box(x, z0, x + 0.1, z1) for x, z in ((2.95, 1.0), (5.95, 2.5)) for z0, z1 in ((0.0, z), (z + 0.9, 4.5))]
    world = BoxWorld(9.0, 4.5, tuple(walls), Camera(32, 32))
    world.reset(1.5, 2.0, 0.0)
    run(explorer, world, 60, seed)
    known = explorer.map()
    assert known is not None
    return float(np.count_nonzero(known.occupancy)) * known.frame.resolution**2
