"""A comparison of the smallest size, and all that it leaves behind."""

import csv
import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from deux.environment.egocentric import Crops
from deux.policies.policy_files import save_policy
from deux.registry import registry
from deux.testing.learned_explorers import untrained_policy

SMALL = ["task=compare_explorers", "scenes.test=2", "compare.steps=6"]


def episodes(run: Path) -> dict[str, dict]:
    """The finished episodes, by the names of their folders; without the time that they took."""
    found = {path.parent.name: json.loads(path.read_text()) for path in (run / "episodes").glob("*/episode.json")}
    return {name: {key: found[name][key] for key in found[name] if key != "seconds"} for name in sorted(found)}


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def compare(tiny):
    """Run a small comparison in a folder of its own: compare(run, *overrides)."""

    def run(folder: Path, *overrides: str, figures: bool = False):
        return tiny(folder.parent, *SMALL, f"hydra.run.dir={folder}", *overrides, figures=figures)

    return run


@pytest.fixture(scope="module")
def finished(compare, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("compared") / "run"
    outcome = compare(folder, "compare.explorers=[frontier,random]", figures=True)
    assert (outcome.code, outcome.err) == (0, "")
    assert "What the explorers saw" in outcome.out
    return folder


def test_everything_that_a_comparison_leaves_behind(finished):
    results = json.loads((finished / "results.json").read_text())
    assert results["scenes"] == ["apartment_200000", "apartment_200001"]
    assert list(results["explorers"]) == ["frontier", "random"]
    found = rows(finished / "episodes.csv")
    assert [(row["explorer"], row["scene"], row["frames"]) for row in found[1:3]] == [
        ("frontier", "apartment_200001", "6"),
        ("random", "apartment_200000", "6"),
    ]
    areas = [float(row["area_seen"]) for row in found if row["explorer"] == "random"]
    assert results["explorers"]["random"]["area_seen"]["mean"] == pytest.approx(np.mean(areas))
    assert [row["explorer"] for row in rows(finished / "table.csv")] == ["frontier", "random"]
    page = (finished / "table.md").read_text()
    assert page.startswith("# Explorers compared: 2 scenes, 1 x 6 steps in each")
    assert "| frontier |" in page
    assert "More than random in the same scene" in page
    assert cv2.imread(str(finished / "figures" / "trajectories.png")).std() > 10


def test_all_explorers_begin_alike_in_each_scene(finished):
    starts = {(e["scene"], *e["trajectory"][0], e["seed"]) for e in episodes(finished).values()}
    assert len(starts) == 2


def test_a_killed_comparison_goes_on_where_it_was(compare, finished, tmp_path):
    killed = tmp_path / "run"
    shutil.copytree(finished, killed)
    for file in ("results.json", "table.md", "episodes/random-apartment_200001-00/episode.json"):
        (killed / file).unlink()
    kept = {path: path.stat().st_mtime_ns for path in (killed / "episodes").rglob("*.json")}
    assert len(kept) == 3
    assert compare(killed, "compare.explorers=[frontier,random]").code == 0
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert episodes(killed) == episodes(finished)
    assert (killed / "table.md").read_bytes() == (finished / "table.md").read_bytes()


class Faulty(registry().get("explorers", "random")):
    def act(self, observation):
        raise ValueError("no way out")


def test_an_explorer_that_fails_is_named_and_the_others_are_compared(compare, tmp_path):
    registry().register("explorers", "faulty", Faulty)
    try:
        outcome = compare(tmp_path / "run", "compare.explorers=[faulty,random]")
        alone = compare(tmp_path / "alone", "compare.explorers=[faulty]")
    finally:
        registry().unregister("explorers", "faulty")
    told = r"faulty failed, in 2 episodes with ValueError: no way out: .*/faulty-\S+/failure.txt has the stack trace"
    assert outcome.code == alone.code == 1
    assert re.search(told, outcome.sentence), outcome.sentence
    assert re.search(told, alone.sentence), alone.sentence
    results = json.loads((tmp_path / "run/results.json").read_text())
    assert list(results["explorers"]) == ["random"]
    assert "no way out" in results["left_out"]["faulty"]
    assert not (tmp_path / "alone/results.json").exists()


def test_episodes_of_other_settings_are_refused(compare, finished):
    sentence = compare(finished, "compare.explorers=[frontier,random]", "compare.steps=7").sentence
    assert "contains a run with other settings (compare.steps: 6 there, 7 here)" in sentence


@pytest.mark.slow  # tests/studies/test_comparison_episodes.py looks at the same without the command
def test_processes_change_nothing(compare, finished, tmp_path):
    chosen = ["compare.explorers=[frontier,random]", "collect.processes=2"]
    assert compare(tmp_path / "run", *chosen).code == 0
    assert episodes(tmp_path / "run") == episodes(finished)


def test_guided_and_learned_explorers_take_part(compare, model_file, tmp_path):
    policy = tmp_path / "policy.safetensors"
    save_policy(policy, untrained_policy(Crops()))
    chosen = ["compare.explorers=[deux,coverage]", "explore=coverage", f"explore.weights={policy}", "compare.seeds=2"]
    outcome = compare(tmp_path / "run", *chosen, "scenes.test=1", f"seed_model.checkpoint={model_file('kbnet')}")
    assert (outcome.code, outcome.err) == (0, "")
    found = episodes(tmp_path / "run")
    assert list(found) == [f"{name}-apartment_200000-0{i}" for name in ("coverage", "deux") for i in (0, 1)]
    assert found["coverage-apartment_200000-00"]["seed"] != found["coverage-apartment_200000-01"]["seed"]
    assert json.loads((tmp_path / "run" / "results.json").read_text())["own_rewards"] == {"coverage": "coverage"}


def test_no_depth_model_is_loaded_for_explorers_that_need_none(compare, tmp_path):
    chosen = ["compare.explorers=[random]", "scenes.test=1", "seed_model.checkpoint=nowhere"]
    assert compare(tmp_path / "run", *chosen).code == 0
    assert json.loads((tmp_path / "run" / "run.json").read_text())["seed model"] is None
    sentence = compare(tmp_path / "other", "compare.explorers=[deux]", *chosen[1:]).sentence
    assert sentence.startswith("there is no model ")


def test_files_are_explored_as_they_are(compare, room, tmp_path):
    scene = room("compared", "floor", "walls", "furniture")
    chosen = ["compare.explorers=[random]", "scenes=files", f"scenes.test={scene}"]
    outcome = compare(tmp_path / "run", *chosen)
    assert (outcome.code, outcome.err) == (0, "")
    (episode,) = episodes(tmp_path / "run").values()
    assert episode["exploration"]["objects_seen"] is None  # nothing is labelled
    assert "semantic_reconstruction" not in episode["exploration"]["rewards"]
    assert "| random |" in (tmp_path / "run" / "table.md").read_text()
    sentence = compare(tmp_path / "other", *chosen, "compare.figure_scene=1").sentence
    assert sentence == "compare.figure_scene is 1, but there is 1 scene, counted from 0."


def test_a_damaged_episode(compare, finished, tmp_path):
    shutil.copytree(finished, tmp_path / "run")
    (tmp_path / "run" / "episodes" / "random-apartment_200000-00" / "episode.json").write_text("{}")
    sentence = compare(tmp_path / "run", "compare.explorers=[frontier,random]").sentence
    assert "random-apartment_200000-00/episode.json is damaged, it is not an episode" in sentence
