from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deux.contracts import Episode, Experience, Explorer, Observation, Reward
from deux.environment.egocentric import Crops
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import GridFrame
from deux.geometry.robot import Robot
from deux.policies.policy_files import save_policy
from deux.registry import registry
from deux.studies.participants import Participants, find_participants, make_rewards
from deux.testing.learned_explorers import untrained_policy


@pytest.fixture
def policy(tmp_path) -> Path:
    """An untrained policy, whose curiosity has learned to foresee other changes than none."""
    foreseen = {
        name: 0.0 * value + 0.01 for name, value in registry().create("rewards", "curiosity", {}).state().items()
    }
    path = tmp_path / "policy.safetensors"
    save_policy(path, replace(untrained_policy(Crops()), reward_state=foreseen))
    return path


def participants(*named: str, configured: str = "deux", has_model: bool = False, **options: object) -> Participants:
    chosen = registry().choose("explorers", {"name": configured, **options})
    return find_participants(named or None, chosen, has_model)


def test_an_explorer_that_needs_a_model_is_left_out_with_a_hint_unless_it_is_named():
    found = participants()
    assert "seed_model.checkpoint= to one, such as kbnet-indoor" in found.left_out["deux"]
    assert {"random", "frontier"} <= {choice.name for choice in found.explorers}
    with pytest.raises(DeuxError, match=r"needs a depth model: set seed_model\.checkpoint="):
        participants("random", "deux")
    named = participants("random", "deux", has_model=True)
    assert [choice.name for choice in named.explorers] == ["random", "deux"]


def test_a_learned_explorer_without_its_policy_is_left_out_unless_it_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(registry().get("explorers", "novelty"), "shipped_weights", tmp_path / "none.safetensors")
    assert "there is no policy file" in participants().left_out["novelty"]
    with pytest.raises(DeuxError, match="there is no policy file"):
        participants("novelty")


def test_the_explorer_that_is_chosen_keeps_its_options(policy):
    found = participants("coverage", "random", configured="coverage", weights=str(policy))
    assert found.explorers[0].settings["weights"] == str(policy)
    assert found.own_rewards == {"coverage": "coverage"}
    assert len(found.identity["coverage"]["is"]) == 16
    assert found.identity["random"]["is"] is None


def test_a_reward_that_learns_is_given_only_where_an_explorer_sought_it(policy):
    assert "curiosity" not in participants("random").rewards
    found = participants("random", "curiosity", configured="curiosity", weights=str(policy))
    assert {"coverage", "novelty", "curiosity", "smooth_coverage", "semantic_reconstruction"} <= set(found.rewards)
    assert found.rewards["coverage"] == {}
    # What the policy's model learned judges, and it learns no more: the same in every episode.
    first, second = (_curiosity(make_rewards({"curiosity": found.rewards["curiosity"]})["curiosity"]) for _ in range(2))
    assert first == second
    untaught = _curiosity(make_rewards({"curiosity": {}})["curiosity"])
    assert first[1] > 0.0
    assert first != untaught


def _curiosity(reward) -> list[float]:
    camera, robot = Camera(8, 8), Robot()
    values = []
    reward.reset(Episode(0, 3, camera, robot))
    rng = np.random.default_rng(0)
    for step in range(3):
        observation = Observation(step, np.eye(4), False, np.zeros((0, 0, 3), np.uint8))
        grid, known = rng.integers(0, 3, (20, 20), np.int8), GridFrame(-1.0, -1.0, 20, 20, 0.1)
        values.append(reward(Experience(observation, 0 if step else None, known, grid, grid, grid > 0, {})))
    return values


def test_no_explorer_at_all(monkeypatch):
    monkeypatch.setattr(registry(), "names", lambda kind: ["deux"] if kind == "explorers" else [])
    with pytest.raises(DeuxError, match="there is no explorer to compare: deux needs a depth model"):
        participants()


class Broken(Explorer):
    def __init__(self, gain: float = 1.0) -> None:
        raise ValueError("gain must be\nnegative")

    reset = act = None


class Unnamed(Broken):
    def __init__(self, gain: float) -> None:
        self.gain = gain


@pytest.mark.parametrize(
    ("cls", "reason"),
    [
        (Broken, "broken cannot be created: ValueError: gain must be negative."),
        (Unnamed, "Unnamed needs a value for compare.explorers.gain."),
    ],
)
def test_an_explorer_that_cannot_be_made_is_left_out_unless_it_is_named(cls, reason):
    registry().register("explorers", "broken", cls)
    try:
        found = participants()
        assert found.left_out["broken"] == reason
        assert {"random", "frontier"} <= {choice.name for choice in found.explorers}
        with pytest.raises((ValueError, DeuxError), match=r"gain must be\nnegative|needs a value for compare"):
            participants("random", "broken")
    finally:
        registry().unregister("explorers", "broken")


def test_a_reward_that_cannot_be_made_is_left_out():
    class Greedy(Reward):
        def __init__(self, worth: float) -> None:
            self.worth = worth

        reset = __call__ = None

    registry().register("rewards", "greedy", Greedy)
    try:
        found = participants("random")
    finally:
        registry().unregister("rewards", "greedy")
    assert "greedy" not in found.rewards
    assert found.left_out == {"the reward greedy": "Greedy needs a value for explorer_training.reward_options.worth."}
