"""Every shipped depth model through the command line."""

import json
import math
import shutil
from pathlib import Path

import pytest
import torch

import deux as package
from deux.registry import registry

MODELS = ("kbnet", "voiced", "scaffnet", "fusionnet")


@pytest.fixture(scope="module")
def explored(collected, tmp_path_factory) -> Path:
    """An outputs folder of this file's own that holds the random frames."""
    outputs = tmp_path_factory.mktemp("explored") / "outputs"
    shutil.copytree(collected, outputs)
    return outputs


def test_all_models_are_tested():
    ours = [plugin.name for plugin in registry().plugins("depth_models") if plugin.package == "deux"]
    assert sorted(ours) == sorted(MODELS)


@pytest.mark.parametrize("model", MODELS)
def test_the_whole_experiment(tiny, explored, tmp_path, model):
    outcome = tiny(explored, "explore=deux", f"hydra.run.dir={tmp_path}", model=model)
    assert (outcome.code, outcome.err) == (0, "")
    results = json.loads((tmp_path / "results.json").read_text())
    assert (results["model"], results["explore"]) == (model, "deux")
    assert all(math.isfinite(value) and value > 0 for value in results["metrics"].values())
    assert package.load(tmp_path).max_depth == 10.0


@pytest.mark.parametrize("model", MODELS)
def test_only_the_supervised_model_opens_the_ground_truth(tiny, explored, model_file, tmp_path, model):
    """The files are gone, so nobody can have read them: not the loader, not a loss term, not FusionNet."""
    (dataset,) = explored.glob("datasets/random-*")
    recorded = tmp_path / dataset.name
    shutil.copytree(dataset, recorded)
    for folder in recorded.glob("data/*/ground_truth"):
        shutil.rmtree(folder)
    outcome = tiny(
        tmp_path,
        "task=train",
        f"training_data={recorded}",
        f"foundation.checkpoint={model_file('scaffnet')}",
        f"hydra.run.dir={tmp_path}/run",
        model=model,
    )
    if registry().get("depth_models", model).supervised:
        assert "has no ground truth of apartment_000000-00" in outcome.sentence
    else:
        assert (outcome.code, outcome.err) == (0, "")
        assert (tmp_path / "run" / "model.safetensors").exists()


@pytest.mark.parametrize("model", MODELS)
def test_an_authors_file_as_the_seed_model(tiny, explored, model_file, tmp_path, model):
    modules = package.load(model_file(model)).published_modules()
    published = {group: {f"module.{key}": v for key, v in m.state_dict().items()} for group, m in modules.items()}
    torch.save({"train_step": 1, "optimizer_state_dict": {}, **published}, tmp_path / "published.pth")
    arguments = ["task=collect", "explore=deux", f"seed_model.checkpoint={tmp_path}/published.pth"]
    arguments += ["model.max_depth=10"]
    before = set(explored.glob("datasets/deux-*")), set(explored.glob("seed_models/*"))
    outcome = tiny(explored, *arguments, f"hydra.run.dir={tmp_path}/run", model=model)
    assert (outcome.code, outcome.err) == (0, "")
    assert len(set(explored.glob("datasets/deux-*")) - before[0]) == 1
    assert set(explored.glob("seed_models/*")) == before[1]
