"""Where the final model's training starts from, and what it may learn from."""

import json
import shutil

import pytest
import torch

import deux
from deux.deployment.model_files import model_config, save_model

ALIKE = ["model.margin=0", "model.first_weights=glorot"]  # the options of `model_file`'s models
STILL = ["training.learning_rate=1e-12", "training.warmup_steps=0"]
TRAIN = ["task=train", "explore=random"]


def weights(path):
    return deux.load(path).state_dict()


@pytest.mark.parametrize("model", ["kbnet", "fusionnet"])
def test_a_training_starts_from_the_weights_that_are_named(tiny, model_file, tmp_path, collected, model):
    folder, start = f"hydra.run.dir={tmp_path}/run", model_file(model)
    options = ALIKE if model == "kbnet" else []
    outcome = tiny(collected, *TRAIN, *options, *STILL, folder, f"training.start={start}", model=model)
    assert (outcome.code, outcome.err) == (0, "")
    assert f"starting from {start}" in outcome.out
    assert "is trained on synthetic scenes" not in outcome.out  # a foundation is part of the start
    found, expected = weights(tmp_path / "run"), weights(start)
    assert all(torch.allclose(found[name], expected[name], atol=1e-6) for name in expected)


def test_a_run_does_not_pass_for_one_with_other_weights_of_the_same_name(tiny, model_file, tmp_path, collected):
    start = tmp_path / "start.safetensors"
    shutil.copyfile(model_file("kbnet"), start)
    command = [*TRAIN, *ALIKE, f"hydra.run.dir={tmp_path}/run", f"training.start={start}"]
    assert tiny(collected, *command).code == 0
    assert "trained before" in tiny(collected, *command).out
    model = deux.load(start)
    with torch.no_grad():
        next(model.parameters()).add_(0.1)
    save_model(start, model, "kbnet", model_config(start).settings)
    assert tiny(collected, *command).sentence == (
        f"{tmp_path}/run contains a run with other weights, the files of training.start have changed since it started: "
        "choose another folder with hydra.run.dir=... or delete this one."
    )


def test_seed_models_start_from_scratch(tiny, model_file, tmp_path):
    start = f"training.start={model_file('kbnet')}"
    outcome = tiny(tmp_path, "task=collect", "explore=deux", "seed=1", *ALIKE, *STILL, start)
    assert (outcome.code, outcome.err) == (0, "")
    (seed_model,) = tmp_path.glob("seed_models/kbnet-*")
    assert json.loads((seed_model / "run.json").read_text())["training"]["start"] is None
    found, given = weights(seed_model), weights(model_file("kbnet"))
    assert not all(torch.allclose(found[name], given[name], atol=1e-3) for name in given)


@pytest.mark.parametrize(
    ("model", "options", "message"),
    [
        ("voiced", [], "is a kbnet, and a voiced is to be trained: choose model=kbnet"),
        ("kbnet", ["model.max_depth=8", *ALIKE], "was made with other options of kbnet (max_depth=10.0)"),
        ("kbnet", ["model.pool_filters=4", *ALIKE], "was made with other options of kbnet (pool_filters=8)"),
    ],
)
def test_a_start_that_does_not_fit_is_reported_before_any_work(tiny, model_file, tmp_path, model, options, message):
    start = f"training.start={model_file('kbnet')}"
    assert message in tiny(tmp_path, *TRAIN, *options, start, model=model).sentence
    assert not list(tmp_path.glob("datasets/*"))


def test_a_start_that_is_not_there_is_reported(tiny, tmp_path):
    assert "there is no model" in tiny(tmp_path, *TRAIN, "training.start=nothing").sentence


def test_an_unsupervised_model_reads_ground_truth_only_where_that_is_set(tiny, collected, tmp_path):
    terms = ["color_consistency", "structural_consistency", "local_smoothness", "sparse_depth"]
    objective = ["objective={supervised_depth: 1.0, " + ", ".join(f"{term}: null" for term in terms) + "}"]
    folder = f"hydra.run.dir={tmp_path}/run"
    refused = tiny(collected, *TRAIN, folder, *objective).sentence
    assert "training.supervised=true" in refused
    outcome = tiny(collected, *TRAIN, folder, *objective, "training.supervised=true")
    assert (outcome.code, outcome.err) == (0, "")
    assert "train/supervised_depth" in next((tmp_path / "run" / "logs").rglob("metrics.csv")).read_text()


def test_the_augmentation_is_that_of_the_configuration(tiny, collected, tmp_path):
    """Samples of another size than the frames reach the network."""
    augmentation = "training.augmentation={sizes: [[32, 40]], density: [0.02, 0.1], noise: 0.05}"
    outcome = tiny(collected, *TRAIN, f"hydra.run.dir={tmp_path}/run", augmentation)
    assert (outcome.code, outcome.err) == (0, "")
    wrong = tiny(collected, *TRAIN, "training.augmentation={sizes: [[32, 0]]}").sentence
    assert "training.augmentation.sizes" in wrong
