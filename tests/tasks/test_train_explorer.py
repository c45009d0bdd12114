"""`task=train_explorer`: what it leaves behind, and what its policy does in the next command."""

import shlex

import cv2
import pytest

from deux.configuration import compose
from deux.policies.policy_files import load_policy
from deux.policies.training_state import load_training_state

SMALL = [
    "task=train_explorer",
    "explore=novelty",
    "explorer_training.scenes=1",
    "explorer_training.episode=20",
    "explorer_training.environments=2",
    "explorer_training.rollout=16",
    "explorer_training.batch_size=16",
    "explorer_training.checkpoint=1",
]


@pytest.fixture(scope="module")
def trained(tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained") / "a run"
    outcome = tiny(folder.parent, *SMALL, "explorer_training.steps=96", f"hydra.run.dir={folder}")
    assert (outcome.code, outcome.err) == (0, "")
    return folder, outcome.out


def test_the_policy_records_what_made_it(trained):
    folder, _ = trained
    made_by = load_policy(folder / "policy.safetensors").made_by
    assert (made_by["reward"], made_by["seed"]) == ("novelty", 0)
    assert made_by["scenes"] == ["apartment:1:300000"], "the policy must not learn in the experiment's own flats"
    assert made_by["settings"]["steps"] == 96
    assert made_by["curve"]["steps"][-1] == 96
    # Of 20 steps, each worth at most 1.
    assert all(0.0 < reward <= 21.0 for reward in made_by["curve"]["reward"])


def test_the_command_that_is_printed_explores_with_the_policy(trained):
    folder, said = trained
    command = said.partition("Explore with it: ")[2].splitlines()[0]
    chosen = compose(shlex.split(command)[3:]).explore  # the folder's name has a space in it
    assert (chosen.name, chosen.weights) == ("novelty", f"{folder}/policy.safetensors")


def test_the_figure_and_the_logs_are_there(trained):
    folder, _ = trained
    assert cv2.imread(str(folder / "figures" / "learning_curve.png")).shape[1] > 500
    logs = {path.name.split(".")[0] for path in (folder / "logs" / "from_0").iterdir()}
    assert logs == {"events", "progress"}


def test_the_same_command_trains_no_more(trained, tiny):
    folder, _ = trained
    before = load_training_state(folder / "checkpoint.pt").steps
    outcome = tiny(folder.parent, *SMALL, "explorer_training.steps=96", f"hydra.run.dir={folder}")
    assert outcome.code == 0
    assert "This run is complete: " in outcome.out
    assert load_training_state(folder / "checkpoint.pt").steps == before == 96


def test_a_folder_with_another_training_is_refused(trained, tiny):
    folder, _ = trained
    outcome = tiny(folder.parent, *SMALL, "explorer_training.steps=32", f"hydra.run.dir={folder}")
    assert outcome.code == 1
    assert "explorer_training.steps: 96 there, 32 here" in outcome.err


def test_weights_to_start_from_are_refused_since_a_new_policy_is_trained(tiny, tmp_path):
    outcome = tiny(tmp_path, *SMALL, "explore.weights=earlier.safetensors")
    assert outcome.sentence.startswith("explore.weights=earlier.safetensors has no effect with task=train_explorer")
    assert not list(tmp_path.glob("**/policy.safetensors"))


def test_an_explorer_collects_with_the_policy_and_anew_with_another_one(trained, tiny):
    folder, _ = trained
    copy = folder.parent / "copy.safetensors"
    collect = ["task=collect", "explore=novelty", f"explore.weights={copy}"]
    datasets = []
    for source in (folder / "policy.safetensors", None):
        if source is not None:
            copy.write_bytes(source.read_bytes())
        else:  # the same name, but the explorer that ships
            from deux_plugins.explorers.learned import NoveltyExplorer

            copy.write_bytes(NoveltyExplorer.shipped_weights.read_bytes())
        outcome = tiny(folder.parent, *collect)
        assert (outcome.code, outcome.err) == (0, "")
        datasets.append({path.name for path in (folder.parent / "datasets").glob("novelty-*")})
    assert [len(found) for found in datasets] == [1, 2], "frames of another policy were used again"


def test_an_explorer_that_learns_nothing_is_reported(tiny, tmp_path):
    outcome = tiny(tmp_path, "task=train_explorer", "explore=frontier")
    assert outcome.code == 1
    assert "explore=frontier is not a learned explorer: task=train_explorer takes coverage" in outcome.err


def test_impossible_settings_are_reported(tiny, tmp_path):
    outcome = tiny(tmp_path, *SMALL, "explorer_training.batch_size=64")
    assert outcome.code == 1
    assert "explorer_training.batch_size is 64: it must be at least 2 and at most 32." in outcome.err


def test_a_missing_weights_file_is_reported(tiny, tmp_path):
    outcome = tiny(tmp_path, "task=collect", "explore=novelty", "explore.weights=nowhere.safetensors")
    assert outcome.code == 1
    assert "there is no policy file nowhere.safetensors" in outcome.err
