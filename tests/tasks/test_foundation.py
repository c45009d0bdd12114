"""FusionNet's ScaffNet: trained first by the same command, taken from a checkpoint, and shared between runs."""

import json
import shutil

import pytest
import torch

import deux
from deux.collection.pipeline import read_manifest
from deux.deployment.model_files import save_model
from deux.registry import registry


@pytest.fixture(scope="module")
def founded(tiny, collected, tmp_path_factory):
    """An outputs folder with a FusionNet that was trained on random frames without any checkpoint given."""
    outputs = tmp_path_factory.mktemp("founded") / "outputs"
    shutil.copytree(collected, outputs)
    outcome = tiny(outputs, "task=train", "explore=random", f"hydra.run.dir={outputs}/fusionnet", model="fusionnet")
    assert (outcome.code, outcome.err) == (0, "")
    return outputs, outcome.out


def test_scaffnet_is_trained_first_and_stays_as_it_is(founded):
    outputs, said = founded
    assert "fusionnet is built on scaffnet, which is trained on synthetic scenes first" in said
    (foundation,) = outputs.glob("foundations/scaffnet-*/model.safetensors")
    scaffnet, fusionnet = deux.load(foundation), deux.load(outputs / "fusionnet")
    inside = fusionnet.scaffnet.state_dict()
    assert all(torch.equal(inside[name], value) for name, value in scaffnet.state_dict().items())
    assert not scaffnet.training


def test_the_synthetic_flats_are_none_of_the_experiments(founded):
    outputs, _ = founded
    (synthetic,) = outputs.glob("datasets/synthetic-*")
    (explored,) = outputs.glob("datasets/random-*")
    scenes = [{s["identity"] for s in read_manifest(d)["specification"]["scenes"]} for d in (synthetic, explored)]
    assert scenes[0]
    assert not scenes[0] & scenes[1]


def test_another_run_takes_the_same_scaffnet(founded, tiny):
    outputs, _ = founded
    outcome = tiny(outputs, "task=train", "explore=random", "training.steps=1", model="fusionnet")
    assert outcome.code == 0
    assert "trained before" in outcome.out
    assert len(list(outputs.glob("foundations/scaffnet-*"))) == 1


def test_a_checkpoint_of_the_users(founded, tiny):
    outputs, _ = founded
    (folder,) = outputs.glob("foundations/scaffnet-*")
    scaffnet = deux.load(folder)
    with torch.no_grad():
        for parameter in scaffnet.parameters():
            parameter += 0.25
    given = outputs / "given.safetensors"
    settings = json.loads((folder / "run.json").read_text())["model"]
    save_model(given, scaffnet, settings.pop("name"), settings)
    run = outputs / "with_checkpoint"
    arguments = ["task=train", "explore=random", f"foundation.checkpoint={given}", f"hydra.run.dir={run}"]
    outcome = tiny(outputs, *arguments, model="fusionnet")
    assert (outcome.code, outcome.err) == (0, "")
    assert "is trained on synthetic scenes" not in outcome.out
    inside = deux.load(run).scaffnet.state_dict()
    assert all(torch.equal(inside[name], value) for name, value in scaffnet.state_dict().items())


def test_the_seed_model_is_built_on_it_too(founded, tiny):
    outputs, _ = founded
    outcome = tiny(outputs, "task=collect", "explore=deux", f"hydra.run.dir={outputs}/deux", model="fusionnet")
    assert (outcome.code, outcome.err) == (0, "")
    assert len(list(outputs.glob("foundations/scaffnet-*"))) == 1
    assert list(outputs.glob("seed_models/fusionnet-*/model.safetensors"))
    assert list(outputs.glob("datasets/deux-*"))


def test_a_checkpoint_that_does_not_fit(founded, tiny, trained):
    outputs, _ = founded
    arguments = ["task=train", "explore=random", "training.steps=3"]
    outcome = tiny(outputs, *arguments, f"foundation.checkpoint={trained}/trained", model="fusionnet")
    assert "is a kbnet that does not fit the scaffnet that fusionnet is built on: it lacks" in outcome.sentence
    outcome = tiny(outputs, *arguments, "foundation.checkpoint=nowhere", model="fusionnet")
    assert "there is no model" in outcome.sentence
    outcome = tiny(outputs, *arguments, "foundation.steps=0", model="fusionnet")
    assert outcome.sentence == "foundation.steps is 0: it must be at least 1."


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["model.max_depth=8"], "(max_depth=10.0)"),
        (["model.scaffnet_max_depth=8", "model.min_depth=0.2"], "(min_depth=0.1, max_depth=10.0)"),
        (["model.scaffnet_pools=[5,7,9,11,13]"], "(pools=[13, 17, 19, 21, 25])"),
    ],
)
def test_a_checkpoint_of_other_options_is_reported_before_any_work(tiny, model_file, tmp_path, options, said):
    chosen = f"foundation.checkpoint={model_file('scaffnet')}"
    sentence = tiny(tmp_path, "task=train", "explore=random", chosen, *options, model="fusionnet").sentence
    assert sentence.startswith(f"{chosen} was made with other options of scaffnet {said} than fusionnet needs")
    assert not list(tmp_path.glob("datasets/*"))


def test_options_that_change_nothing_inside_may_differ(tiny, collected, tmp_path):
    """A margin is of no account inside FusionNet, and a range of ScaffNet's own is what it needs."""
    network = {"filters": (4, 4, 8, 8, 8), "decoder_filters": (8, 8, 8, 8, 4), "margin": 4, "max_depth": 9.0}
    scaffnet = registry().create("depth_models", "scaffnet", network)
    save_model(tmp_path / "given.safetensors", scaffnet, "scaffnet", network)
    arguments = ["task=train", "explore=random", f"foundation.checkpoint={tmp_path}/given.safetensors"]
    arguments += ["model.scaffnet_max_depth=9", f"hydra.run.dir={tmp_path}/run"]
    outcome = tiny(collected, *arguments, model="fusionnet")
    assert (outcome.code, outcome.err) == (0, "")
    assert deux.load(tmp_path / "run").scaffnet.max_depth == 9.0
