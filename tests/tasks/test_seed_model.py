"""The model that guides the explorer: another kind than the final one, a given one, and what makes it another model."""

import json
from pathlib import Path

import pytest

from deux.configuration import compose, sections_of
from deux.deployment.model_files import model_name
from deux.deployment.published_checkpoints import save_published
from deux.registry import registry
from deux.tasks.checkpoints import weights_identity
from deux.tasks.datasets import Datasets
from deux.tasks.model_training import Training
from deux.tasks.seed_model import SeedModel, SeedModelSettings

GUIDED = ["task=collect", "explore=deux"]


def seed_models(outputs: Path) -> dict[str, str]:
    """The kept seed models: names of their folders, and of what kind each is."""
    return {path.name: model_name(path) for path in (outputs / "seed_models").glob("[!.]*")}


def test_a_seed_model_of_another_kind_has_its_own_objective_and_learning_rate(tiny, tmp_path):
    outcome = tiny(tmp_path, *GUIDED, "seed_model.name=voiced", "trainer.max_steps=1")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Seed model: voiced on the random frames" in outcome.out
    (found,) = seed_models(tmp_path).items()
    assert found[1] == "voiced"
    made_of = json.loads((tmp_path / "seed_models" / found[0] / "run.json").read_text())
    assert made_of["model"]["name"] == "voiced"
    assert "image_filters" not in made_of["model"] or made_of["model"]["image_filters"] != [4, 8, 8, 8, 8]
    assert made_of["training"]["learning_rate"] == 2e-4 != 5e-4  # VOICED's, not the final KBNet's
    assert made_of["objective"] == {}


@pytest.fixture
def recipe():
    """The seed model's recipe by overrides."""

    def make(*overrides):
        chosen = ["task=collect", "explore=deux", "seed_model.checkpoint=null", "scenes.train=1", "scenes.validation=0"]
        sections = sections_of(compose([*chosen, *overrides]))
        datasets = Datasets(sections, ["train"])
        return SeedModel(sections, datasets, Training(sections, datasets, 1))._recipe

    return make


def test_another_kind_has_the_options_of_its_configuration(recipe):
    model = recipe("model=voiced", "seed_model.name=kbnet", "seed_model.options.max_depth=8").model
    assert model.settings == recipe("model=kbnet", "model.max_depth=8").model.settings
    assert (model.settings["margin"], model.settings["first_weights"]) == (4, "he")
    assert recipe("model=voiced", "seed_model.name=kbnet", "seed_model.options.margin=1").model.settings["margin"] == 1


@pytest.mark.parametrize(
    ("overrides", "rate"),
    [
        ([], 2e-4),  # as model=voiced alone has it
        (["training.learning_rate=3e-3"], 3e-3),
        (["scale=paper"], 1e-4),
    ],
)
def test_another_kind_is_trained_as_a_preset_or_the_user_sets(recipe, overrides, rate):
    training = recipe("model=kbnet", "seed_model.name=voiced", *overrides).training
    assert training.learning_rate == rate
    assert training == recipe("model=voiced", *overrides).training


def test_an_option_that_only_the_final_model_changes_is_not_the_other_ones(recipe):
    assert recipe("model=scaffnet", "seed_model.name=kbnet").training.batch_size == 4
    assert recipe("model=scaffnet", "training.batch_size=6", "seed_model.name=kbnet").training.batch_size == 6


def test_a_shipped_model_guides_unless_another_is_asked_for(tiny, tmp_path):
    outcome = tiny(tmp_path, *GUIDED, "seed_model.checkpoint=kbnet-indoor")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Seed model: kbnet-indoor\n" in outcome.out
    assert not list(tmp_path.glob("seed_models/*"))
    sentence = tiny(tmp_path, *GUIDED, "seed_model.checkpoint=kbnet-indoor", "seed_model.name=voiced").sentence
    assert sentence == (
        "seed_model.name=voiced and seed_model.checkpoint=kbnet-indoor are two seed models: set "
        "seed_model.checkpoint=null to use the former, or leave out seed_model.name."
    )


def test_a_given_seed_model_is_named_and_none_is_trained(tiny, model_file, tmp_path):
    checkpoint = model_file("voiced")
    outcome = tiny(tmp_path, *GUIDED, f"seed_model.checkpoint={checkpoint}")
    assert (outcome.code, outcome.err) == (0, "")
    assert f"Seed model: {checkpoint}\n" in outcome.out
    assert "random frames" not in outcome.out
    assert not list(tmp_path.glob("seed_models/*"))


def test_a_published_checkpoint_guides_with_the_options_that_it_is_given(model_file, tmp_path):
    """Such a file holds no options: with others it is another model, and leads to other frames."""
    file = tmp_path / "kbnet.pth"
    small = {"image_filters": [4, 8, 8, 8, 8], "depth_filters": [4] * 5, "decoder_filters": [8, 8, 8, 8, 4]}
    near, far = (
        registry().choose("depth_models", {"name": "kbnet", **small, "max_depth": metres}) for metres in (8.0, 10.0)
    )
    save_published(near.create(), "kbnet", file)
    published = SeedModelSettings(None, str(file), "random", 1)
    assert published.load(near).weights == published.load(near).weights != published.load(far).weights
    ours = SeedModelSettings(None, str(model_file("kbnet")), "random", 1)
    assert ours.load(near).weights == ours.load(far).weights == weights_identity(model_file("kbnet"))


def test_what_changes_its_weights_makes_another_model(tiny, tmp_path):
    counts = []
    for option in ("seed=0", "trainer.max_steps=1", "training.learning_rate=0.001", "training.checkpoint_minutes=3"):
        assert tiny(tmp_path, *GUIDED, option).code == 0
        counts.append(len(seed_models(tmp_path)))
    assert counts == [1, 2, 3, 3]


def test_its_frames_may_come_from_other_scenes(tiny, tmp_path):
    other = ["seed_model.source=apartments", "seed_model.scenes=1"]
    outcome = tiny(tmp_path, *GUIDED, *other, "trainer.max_steps=1")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Seed model: kbnet on the random frames of 1 further apartments" in outcome.out
    (random,), (guided,) = (
        [json.loads(file.read_text())["specification"] for file in tmp_path.glob(f"datasets/{name}-*/manifest.json")]
        for name in ("random", "deux")
    )
    assert len(random["scenes"]) == 1
    assert not {scene["identity"] for scene in random["scenes"]} & {scene["identity"] for scene in guided["scenes"]}


def test_an_unknown_source_of_its_scenes_is_reported_before_any_work(tiny, tmp_path):
    sentence = tiny(tmp_path, *GUIDED, "seed_model.source=apartmens").sentence
    assert sentence.startswith("there is no source of scenes called 'apartmens': did you mean apartments?")
    assert not list(tmp_path.glob("datasets/*"))


def test_an_unknown_kind_is_reported(tiny, tmp_path):
    sentence = tiny(tmp_path, *GUIDED, "seed_model.name=voicd").sentence
    assert sentence.startswith("there is no depth model called 'voicd': did you mean voiced?")


def test_a_model_that_brings_its_weights_is_not_trained(tiny, tmp_path, wall):
    for distance in (1.0, 3.0):
        outcome = tiny(tmp_path, *GUIDED, f"seed_model.name={wall}", f"seed_model.options.distance={distance}")
        assert (outcome.code, outcome.err) == (0, "")
        assert f"Seed model: {wall}, pretrained\n" in outcome.out
    assert not list(tmp_path.glob("seed_models/*"))
    assert len(list(tmp_path.glob("datasets/deux-*"))) == 2  # what guides the robot is part of what makes its frames
    assert not list(tmp_path.glob("datasets/random-*"))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            ["seed_model.name=wall", "seed_model.options.distnce=1"],
            "seed_model.options.distnce is not an option of Wall",
        ),
        (["seed_model.options.distance=1"], "seed_model.options have no effect without seed_model.name"),
    ],
)
@pytest.mark.usefixtures("wall")
def test_wrong_options_of_it_are_reported(tiny, tmp_path, options, sentence):
    assert tiny(tmp_path, *GUIDED, *options).sentence.startswith(sentence)
