import pytest

from deux.report.conditions import conditions, differences, facts, variants

IDENTITY = {
    "task": "experiment",
    "random_seed": 7,
    "renderer": "embree",
    "pose": "simulator",
    "camera": {"width": 64, "hfov": 90.0},
    "robot": {},
    "objective": {"sparse_depth": 0.5},
    "collect": {"steps": 20, "processes": 1},
    "seed": {"checkpoint": None, "steps": 5},
    "foundation": {"flats": 1},
    "training": {"batch_size": 4, "steps": 10, "epochs": 25, "crop": [32, 32], "validations": 1},
    "trainer": {"accelerator": "auto"},
    "evaluation": {"viewpoints": 4, "data": None},
    "explore": {"name": "deux", "temperature": 0.25},
    "model": {"name": "kbnet", "filters": [4, 8]},
    "scenes": {"source": "apartments", "train": 3, "validation": 1, "test": 2},
}


def test_everything_that_matters_is_in_its_place_and_only_there():
    made_of = conditions(IDENTITY)
    assert (made_of.model, made_of.explorer, made_of.seed) == ("kbnet", "deux", 7)
    assert dict(made_of.model_options) == {
        "foundation.flats": "1",
        "model.filters": "[4, 8]",
        "objective.sparse_depth": "0.5",
        "pose": '"simulator"',
        "training.batch_size": "4",
    }
    assert dict(made_of.explorer_options) == {"explore.temperature": "0.25", "seed.steps": "5"}
    both = {"camera.hfov": "90", "camera.width": "64", "renderer": '"embree"', "scenes.source": '"apartments"'}
    assert dict(made_of.training) == {
        **both,
        "collect.steps": "20",
        "scenes.train": "3",
        "training.crop": "[32, 32]",
        "training.steps": "10",
    }
    assert dict(made_of.testing) == {
        **both,
        "scenes.test": "2",
        "evaluation.viewpoints": "4",
        "training.crop": "[32, 32]",
    }
    assert dict(made_of.budget) == {
        "camera.width": "64",
        "collect.steps": "20",
        "training.crop": "[32, 32]",
        "training.steps": "10",
    }


@pytest.mark.parametrize(
    "changes",
    [
        {"robot": None},
        {"random_seed": 8},
        {"callbacks": {}},  # what later versions added and a run does not use
        {"image": None, "sparse_scale": 1000, "export": {"height": 3}},
        {"trainer": {"accelerator": "cpu", "devices": 4}},
        {"camera": {"width": 64.0, "hfov": 90}},
        {"report": {"runs": "x"}, "explorer_training": {"steps": 1}},
    ],
)
def test_what_changes_no_number_changes_no_condition(changes):
    one, other = conditions(IDENTITY), conditions({**IDENTITY, **changes})
    assert (one.training, one.testing, one.model_options, one.explorer_options) == (
        other.training,
        other.testing,
        other.model_options,
        other.explorer_options,
    )


def test_an_option_that_nobody_knows_yet_separates_trainings():
    assert conditions({**IDENTITY, "distractors": {"people": 3}}).training != conditions(IDENTITY).training


@pytest.mark.parametrize("changes", [{"callbacks": {"rounds": 3}}, {"collect": {"steps": 20, "uncertainty": "flip"}}])
def test_what_guides_the_robot_makes_another_explorer_and_no_other_training(changes):
    changed, plain = conditions({**IDENTITY, **changes}), conditions(IDENTITY)
    assert changed.explorer_options != plain.explorer_options
    assert (changed.training, changed.model_options) == (plain.training, plain.model_options)


def test_recorded_data_stand_for_the_test_scenes():
    made_of = conditions({**IDENTITY, "evaluation": {"viewpoints": 4, "data": "void"}})
    assert dict(made_of.testing) == {"evaluation.data": '"void"', "training.crop": "[32, 32]"}


def test_given_frames_have_no_explorer():
    assert conditions({**IDENTITY, "training_data": "void"}).explorer is None


def test_differences_are_told_from_ones_own_side():
    mine, others = facts({"a": 1, "b": {"c": "x"}}), facts({"a": 2, "d": True})
    assert differences(mine, others) == "a=1, b.c=x, d not set"
    assert differences(mine, mine) == ""


def test_variants_are_called_by_what_they_differ_in():
    plain, surface = facts({"explore": {"t": 1}}), facts({"explore": {"t": 1, "pose": "surface"}})
    assert variants([plain, plain]) == {plain: ""}
    assert variants([plain, surface]) == {plain: "pose not set", surface: "pose=surface"}


def test_a_node_that_some_lack_is_one_word():
    plain = facts({"collect": {"uncertainty": "l1"}})
    refreshed = facts({"collect": {"uncertainty": "l1"}, "callbacks": {"every": 1, "rounds": 3}})
    oftener = facts({"collect": {"uncertainty": "flip"}, "callbacks": {"every": 2, "rounds": 3}})
    names = variants([plain, refreshed])
    assert names == {plain: "no callbacks", refreshed: "with callbacks"}
    assert variants([refreshed, oftener])[oftener] == "callbacks.every=2, uncertainty=flip"
