import inspect
from dataclasses import fields

import pytest
import yaml

from deux.collection.specification import DatasetSpec
from deux.configuration import config_folder
from deux.data.augmentation import AugmentationSettings
from deux.mapping.informative_targets import InformativeTargets
from deux.mapping.occupancy import DepthTolerance
from deux.report import conditions as parts
from deux.report.conditions import conditions, differences, flatten_options, variant_labels
from deux.report.older_configurations import current_keys
from deux.training.training_settings import TrainingSettings

CONFIGURATION = {
    "task": "experiment",
    "seed": 7,
    "simulator": {"name": "mesh", "renderer": "embree"},
    "pose": "simulator",
    "camera": {"width": 64, "hfov": 90.0},
    "robot": {},
    "objective": {"sparse_depth": 0.5},
    "collect": {"steps": 20, "processes": 1, "batch_size": 4},
    "seed_model": {"name": None, "checkpoint": None, "steps": 5},
    "foundation": {"scenes": 1},
    "training": {"batch_size": 4, "steps": 10, "epochs": 25, "crop": [32, 32], "validations": 1},
    "trainer": {"accelerator": "auto"},
    "evaluation": {"viewpoints": 4, "data": None},
    "explore": {"name": "deux", "target": "sampled", "temperature": 0.25},
    "model": {"name": "kbnet", "filters": [4, 8]},
    "scenes": {"name": "apartments", "train": 3, "validation": 1, "test": 2},
    "data": {"name": "deux"},
}

OLD_CONFIGURATION = {
    **{key: value for key, value in CONFIGURATION.items() if key not in ("simulator", "seed_model", "data")},
    "random_seed": 7,
    "renderer": "embree",
    "seed": {"checkpoint": None, "steps": 5},
    "foundation": {"flats": 1},
    "scenes": {"source": "apartments", "train": 3, "validation": 1, "test": 2},
    "explore": {"name": "deux", "temperature": 0.25},
    "checkpoint": None,
    "image": None,
    "sparse_scale": 256,
}
"""The same as version 0.1.0 wrote it."""


def test_everything_that_matters_is_in_its_place_and_only_there():
    made_of = conditions(CONFIGURATION)
    assert (made_of.model, made_of.explorer, made_of.seed) == ("kbnet", "deux", 7)
    assert dict(made_of.model_options) == {
        "foundation.scenes": "1",
        "model.filters": "[4, 8]",
        "objective.sparse_depth": "0.5",
        "pose": '"simulator"',
        "training.batch_size": "4",
    }
    guided = {"collect.batch_size": "4", "seed_model.steps": "5"}
    targets = {"explore.target": '"sampled"', "explore.temperature": "0.25"}
    assert dict(made_of.explorer_options) == {**targets, **guided}
    both = {
        "camera.hfov": "90",
        "camera.width": "64",
        "simulator.name": '"mesh"',
        "simulator.renderer": '"embree"',
        "scenes.name": '"apartments"',
        "training.crop": "[32, 32]",
    }
    assert dict(made_of.training_frames) == {**both, "collect.steps": "20", "scenes.train": "3"}
    assert dict(made_of.training) == {**dict(made_of.training_frames), "training.steps": "10"}
    assert dict(made_of.testing) == {**both, "scenes.test": "2", "evaluation.viewpoints": "4"}
    assert dict(made_of.budget) == {
        "camera.width": "64",
        "collect.steps": "20",
        "training.crop": "[32, 32]",
        "training.steps": "10",
    }


def test_a_run_of_an_older_version_has_the_same_conditions():
    assert conditions(OLD_CONFIGURATION) == conditions(CONFIGURATION)
    assert current_keys(CONFIGURATION) == CONFIGURATION
    rounds = {"every": 1, "rounds": 3}
    old = conditions({**OLD_CONFIGURATION, "callbacks": rounds})
    assert old == conditions({**CONFIGURATION, "callbacks": {"active_collection": rounds}})
    recorded = {"viewpoints": 4, "data": "void"}
    old = conditions({**OLD_CONFIGURATION, "evaluation": recorded})
    assert old == conditions({**CONFIGURATION, "evaluation": recorded})


@pytest.mark.parametrize(("map_depth", "meant"), [("predicted", 3.0), ("sensor", 5.0)])
def test_a_range_that_depended_on_the_mapped_depth_is_written_out(map_depth, meant):
    def of_range(max_range):
        return {**CONFIGURATION, "explore": {"name": "deux", "map_depth": map_depth, "max_range": max_range}}

    assert conditions(of_range(None)) == conditions(of_range(meant))
    assert current_keys(of_range(None)) == of_range(meant)
    frontier = {**CONFIGURATION, "explore": {"name": "frontier", "depth": "sensor", "max_range": None}}
    assert current_keys(frontier) == frontier


@pytest.mark.parametrize(
    "changes",
    [
        {"robot": None},
        {"callbacks": {}},  # what later versions added and a run does not use
        {"predict": {"image": None, "sparse_scale": 1000}, "export": {"height": 3}},
        {"trainer": {"accelerator": "cpu", "logger": True, "enable_progress_bar": False}},
        {"camera": {"width": 64.0, "hfov": 90}},
        {"report": {"runs": "x"}, "explorer_training": {"steps": 1}, "compare": {"seeds": 2}},
        {"collect": {"steps": 20, "processes": 8, "batch_size": 4}},
        {"evaluation": {"viewpoints": 4, "data": "void"}},  # which an experiment does not read
        {"telemetry": {"people": 3}},  # a section that nobody knows yet
        {"data": {"name": "void"}},  # how recorded frames are read, and there are none
    ],
)
def test_what_changes_no_number_changes_no_condition(changes):
    assert conditions({**CONFIGURATION, **changes}) == conditions(CONFIGURATION)


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"collect": {"steps": 30}}, "budget"),
        ({"training": {**CONFIGURATION["training"], "steps": 11}}, "budget"),
        ({"trainer": {"max_steps": 1}}, "budget"),
        ({"trainer": {"devices": 2}}, "budget"),  # the batch is of each process
        ({"trainer": {"num_nodes": 2}}, "budget"),
        ({"robot": {"camera_height": 0.4}}, "training_frames"),
        ({"simulator": {"name": "habitat"}}, "training_frames"),
        ({"scenes": {**CONFIGURATION["scenes"], "train": 4}}, "training_frames"),
        ({"scenes": {**CONFIGURATION["scenes"], "test": 4}}, "testing"),
        ({"evaluation": {"viewpoints": 5}}, "testing"),
        ({"trainer": {"precision": "32-true"}}, "model_options"),
        ({"training": {**CONFIGURATION["training"], "learning_rate": 1e-4}}, "model_options"),
    ],
)
def test_what_changes_numbers_changes_its_part(changes, part):
    changed, plain = conditions({**CONFIGURATION, **changes}), conditions(CONFIGURATION)
    assert getattr(changed, part) != getattr(plain, part)
    separated = (changed.training, changed.testing) != (plain.training, plain.testing)
    assert separated == (part != "model_options")


@pytest.mark.parametrize(
    "changes",
    [
        {"callbacks": {"active_collection": {"rounds": 3}}},
        {"collect": {"steps": 20, "uncertainty": "flip"}},
        {"collect": {"steps": 20, "uncertainty_options": {"window": 3}}},
        {"seed_model": {"steps": 6}},
        {"collect": {"steps": 20, "batch_size": 1}},  # on a card predictions depend on their batch
    ],
)
def test_what_guides_the_robot_makes_another_explorer_and_no_other_training(changes):
    changed, plain = conditions({**CONFIGURATION, **changes}), conditions(CONFIGURATION)
    assert changed.explorer_options != plain.explorer_options
    assert (changed.training, changed.model_options) == (plain.training, plain.model_options)


def test_an_explorer_without_a_model_does_not_depend_on_what_guides_others():
    plain = {**CONFIGURATION, "explore": {"name": "frontier"}}
    guidance = {"seed_model": {"steps": 6}, "collect": {"steps": 20, "uncertainty": "flip", "correct_depth": False}}
    assert conditions({**plain, **guidance}) == conditions(plain)
    mapped = {**plain, "explore": {"name": "frontier", "depth": "predicted"}}
    assert conditions({**mapped, **guidance}) != conditions(mapped), "what maps predicted depth needs a model"
    absent = {**plain, "explore": {"name": "of another package"}}
    assert conditions({**absent, **guidance}) != conditions(absent)


def test_recorded_data_stand_for_the_test_scenes():
    made_of = conditions({**CONFIGURATION, "task": "evaluate", "evaluation": {"viewpoints": 4, "data": "void"}})
    expected = {"evaluation.data": '"void"', "data.name": '"deux"', "training.crop": "[32, 32]"}
    assert dict(made_of.testing) == expected


def test_given_frames_have_no_explorer():
    assert conditions({**CONFIGURATION, "training_data": "void"}).explorer is None


UNRELATED = {
    "training": {"num_workers", "checkpoint_minutes", "validations", "cuda_graphs"},
    "": {
        "defaults",
        "task",
        "seed",
        "training_data",
        "predict",
        "export",
        "export_dataset",
        "explorer_training",
        "compare",
        "paths",
    },
}
"""Options and sections that no number of an experiment depends on, or that are known otherwise."""


def test_every_option_of_the_training_is_assigned_to_a_part():
    """A new option belongs into one of the lists, or here, on purpose."""
    assigned = {key for part in (parts.MODEL, parts.BUDGET) for key in part}
    known = {field.name for field in fields(TrainingSettings)} - UNRELATED["training"]
    assert {key.removeprefix("training.") for key in assigned if key.startswith("training.")} == known


def test_every_section_of_the_configuration_is_assigned_to_a_part():
    explorer, frames = (
        (parts.EXPLORER, parts.GUIDANCE),
        (parts.TRAINING_FRAMES, parts.TEST_FRAMES, parts.RECORDED_TEST_FRAMES),
    )
    assigned = {key.partition(".")[0] for part in (parts.MODEL, *explorer, *frames, parts.BUDGET) for key in part}
    sections = current_keys(yaml.safe_load((config_folder() / "config.yaml").read_text()))
    assert set(sections) <= assigned | UNRELATED[""]


def test_differences_are_described_from_ones_own_side():
    mine, others = flatten_options({"a": 1, "b": {"c": "x"}}), flatten_options({"a": 2, "d": True})
    assert differences(mine, others) == "a=1, b.c=x, d not set"
    assert differences(mine, mine) == ""


def test_variants_are_called_by_what_they_differ_in():
    plain = flatten_options({"explore": {"t": 1}})
    surface = flatten_options({"explore": {"t": 1, "pose": "surface"}})
    assert variant_labels([plain, plain]) == {plain: ""}
    assert variant_labels([plain, surface]) == {plain: "pose not set", surface: "pose=surface"}


def test_a_preset_stands_for_its_options():
    """Only what is left beside the preset tells its sets apart; the sets without it know nothing of it."""
    preset = {"paper": flatten_options({"explore": {"guidance": 1}, "collect": {"uncertainty": "l1"}})}
    plain = flatten_options({"explore": {"guidance": 2}, "collect": {"uncertainty": "flip"}})
    paper = flatten_options({"explore": {"guidance": 1}, "collect": {"uncertainty": "l1"}})
    wider = flatten_options({"explore": {"guidance": 1, "range": 5}, "collect": {"uncertainty": "l1"}})
    partly = flatten_options({"explore": {"guidance": 1}, "collect": {"uncertainty": "flip"}})
    assert variant_labels([plain, paper], preset) == {plain: "", paper: "paper"}
    assert variant_labels([plain, paper, wider, partly], preset) == {
        plain: "guidance=2",
        partly: "guidance=1",
        paper: "paper, range not set",
        wider: "paper, range=5",
    }


def test_options_that_nothing_depends_on_tell_nothing_apart():
    given = flatten_options({"seed_model": {"checkpoint": "kbnet-indoor"}})
    brief, long = (flatten_options({"seed_model": {"explore": "random", "steps": steps}}) for steps in (300, 600))
    assert variant_labels([given, brief]) == {
        given: "seed_model.checkpoint=kbnet-indoor",
        brief: "seed_model.checkpoint not set",
    }
    assert variant_labels([given, brief, long]) == {
        given: "seed_model.checkpoint=kbnet-indoor",
        brief: "seed_model.checkpoint not set, seed_model.steps=300",
        long: "seed_model.checkpoint not set, seed_model.steps=600",
    }


def test_a_section_that_some_lack_is_one_word():
    rounds = {"active_collection": {"every": 1, "rounds": 3}}
    often = {"active_collection": {"every": 2, "rounds": 3}}
    plain = flatten_options({"collect": {"uncertainty": "l1"}})
    refreshed = flatten_options({"collect": {"uncertainty": "l1"}, "callbacks": rounds})
    oftener = flatten_options({"collect": {"uncertainty": "flip"}, "callbacks": often})
    assert variant_labels([plain, refreshed]) == {plain: "no callbacks", refreshed: "with callbacks"}
    label = variant_labels([refreshed, oftener])[oftener]
    assert label == "callbacks.active_collection.every=2, uncertainty=flip"


def test_an_option_that_came_later_and_changes_nothing_tells_no_runs_apart():
    """As a sweep that was begun with a version without it and ended with one that writes its default down."""
    later = {"explore": {"max_incidence": 90.0}, "training": {"averaging": 0.0, "tf32": False, "compile": False}}
    later["training"]["augmentation"] = {"scale": [1.0, 1.0]}
    written = {key: {**CONFIGURATION[key], **options} for key, options in later.items()}
    assert conditions({**CONFIGURATION, **written}) == conditions(CONFIGURATION)
    chosen = {**CONFIGURATION, "explore": {**CONFIGURATION["explore"], "max_incidence": 81.0}}
    assert conditions(chosen) != conditions(CONFIGURATION)


@pytest.mark.parametrize("key", parts.EARLIER_BEHAVIOUR)
def test_earlier_behaviour_is_that_of_the_parts_alone(key):
    section, name = key.split(".", 1)
    if name == "view_guidance":
        default = inspect.signature(InformativeTargets).parameters["guidance"].default
    elif section == "explore":
        default = getattr(DepthTolerance(), {"max_incidence": "incidence"}.get(name, name))
    elif section == "collect":
        default = getattr(DatasetSpec, name)
    elif name.startswith("augmentation."):
        default = getattr(AugmentationSettings(), name.partition(".")[2])
    else:
        default = getattr(TrainingSettings(), name)
    assert flatten_options({"it": default}) == (("it", parts.EARLIER_BEHAVIOUR[key]),)
