"""Episodes taken again: the same observations and actions, from the stored frames alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_world import ToyScene, ToySimulator, Wanderer, convolving_predictor, guided_explorer

from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.collection.perception import Perception
from deux.collection.replay import ReplayDiverged, replay
from deux.collection.sparse import SparseSettings
from deux.contracts import Action
from deux.errors import DeuxError
from deux_plugins.uncertainties.photometric import L1Residual

SCENE = ToyScene("hall", "toy-22")


def collect(folder: Path, guided: bool) -> tuple[EpisodePlan, Wanderer]:
    """One episode of six steps, and its explorer."""
    plan = EpisodePlan(folder / "hall-00", SCENE, seed=5, steps=6)
    explorer = guided_explorer() if guided else Wanderer()
    model = {"predict_depth": convolving_predictor(), "sparse": SparseSettings(), "uncertainty": L1Residual()}
    explore([plan], ToySimulator, lambda: explorer, **(model if guided else {}))
    return plan, explorer


@pytest.mark.parametrize("guided", [False, True])
def test_the_explorer_sees_and_does_the_same(tmp_path: Path, guided: bool) -> None:
    plan, first = collect(tmp_path, guided)
    simulator = ToySimulator(SCENE)
    second = guided_explorer() if guided else Wanderer()
    perception = Perception(convolving_predictor(), SparseSettings(), L1Residual()) if guided else None
    maps = []
    for step in replay(plan.paths, SCENE, 6, lambda scene: simulator, lambda: second, perception):
        assert not step.rendered
        maps.append(second.map().occupancy[0, 0])
    assert simulator.rendered == 0
    assert maps == [1, 2, 3, 4, 5, 6]  # the map of each step
    assert len(second.seen) == len(first.seen) == 6
    for one, other in zip(first.seen, second.seen, strict=True):
        for name in ("pose", "rgb", "sensor_depth", "predicted_depth", "residual", "labels"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_another_explorer_or_no_episode_is_reported(tmp_path: Path) -> None:
    plan, _ = collect(tmp_path, guided=False)

    class Straight(Wanderer):
        def act(self, observation):
            return Action.RIGHT

    with pytest.raises(ReplayDiverged, match=r"hall-00 cannot be replayed beyond step \d: .* something .* has changed"):
        list(replay(plan.paths, SCENE, 6, ToySimulator, Straight))
    predict = convolving_predictor()
    perception = Perception(lambda *frames: predict(*frames), SparseSettings(), L1Residual())
    with pytest.raises(
        ReplayDiverged, match=r"acts differently .*, as the depth model's predictions .* depend .* on the batch"
    ):
        list(replay(plan.paths, SCENE, 6, ToySimulator, Straight, perception))
    missing = replace(plan, folder=tmp_path / "none")
    with pytest.raises(DeuxError, match="none holds no finished episode to replay"):
        list(replay(missing.paths, SCENE, 6, ToySimulator, Wanderer))
