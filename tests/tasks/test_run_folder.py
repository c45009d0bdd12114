import json

import pytest
import yaml

from deux.errors import DeuxError
from deux.tasks.run_folder import open_run_folder, short_hash


def test_the_same_settings_find_their_folder_again(tmp_path):
    settings = {"model": {"name": "kbnet", "pools": (1, 2)}, "seed": 0}
    for _ in range(2):
        with open_run_folder(tmp_path / "run", settings) as run:
            assert run.path == tmp_path / "run"
    assert json.loads((tmp_path / "run" / "run.json").read_text())["model"]["pools"] == [1, 2]


def test_other_settings_are_refused_by_name(tmp_path):
    with open_run_folder(tmp_path, {"model": {"name": "kbnet"}, "seed": 0}):
        (tmp_path / "checkpoints").mkdir()
    with (
        pytest.raises(DeuxError, match=r"model\.name: kbnet there, voiced here, seed: 0 there, 1 here"),
        open_run_folder(tmp_path, {"model": {"name": "voiced"}, "seed": 1}),
    ):
        pass


def test_other_weights_under_the_same_name_are_refused(tmp_path):
    with open_run_folder(tmp_path, {"seed": 0}, {"training.start": "1a"}):
        (tmp_path / "checkpoints").mkdir()
    for known in ({"training.start": "1a"}, {}):  # and those of files that are gone do not matter
        with open_run_folder(tmp_path, {"seed": 0}, known):
            pass
    with (
        pytest.raises(
            DeuxError, match=r"contains a run with other weights, the files of training\.start have changed since"
        ),
        open_run_folder(tmp_path, {"seed": 0}, {"training.start": "2b"}),
    ):
        pass


def test_a_run_without_a_record_of_its_weights_goes_on(tmp_path):
    """As earlier versions kept none."""
    with open_run_folder(tmp_path, {"seed": 0}):
        (tmp_path / "checkpoints").mkdir()
    with open_run_folder(tmp_path, {"seed": 0}, {"training.start": "1a"}):
        pass
    with pytest.raises(DeuxError), open_run_folder(tmp_path, {"seed": 0}, {"training.start": "2b"}):
        pass


def test_other_recorded_frames_under_the_same_path_are_refused_and_unknown_ones_recorded(tmp_path):
    """A folder of an earlier version has no record of them."""
    with open_run_folder(tmp_path, {"seed": 0}, {"training.start": "1a"}):
        (tmp_path / "checkpoints").mkdir()
    with open_run_folder(tmp_path, {"seed": 0}, {"training.start": "1a"}, {"training_data": "c3"}):
        pass
    assert json.loads((tmp_path / "run.json").read_text()) == {
        "seed": 0,
        "weights of options": {"training.start": "1a"},
        "files of options": {"training_data": "c3"},
    }
    sentence = (
        f"^{tmp_path} contains a run with other recorded frames, the files of training_data have changed since it "
        r"started: choose another folder with hydra\.run\.dir=\.\.\. or delete this one\.$"
    )
    with (
        pytest.raises(DeuxError, match=sentence),
        open_run_folder(tmp_path, {"seed": 0}, {"training.start": "1a"}, {"training_data": "d4"}),
    ):
        pass


def test_an_option_that_came_later_and_is_null_changes_nothing(tmp_path):
    with open_run_folder(tmp_path, {"data": {"scale": 1000.0}}):
        (tmp_path / "checkpoints").mkdir()
    with open_run_folder(tmp_path, {"data": {"scale": 1000.0, "sparse_scale": None}}):
        pass
    with (
        pytest.raises(DeuxError, match=r"data\.sparse_scale: None there, 256\.0 here"),
        open_run_folder(tmp_path, {"data": {"scale": 1000.0, "sparse_scale": 256.0}}),
    ):
        pass


def test_a_run_that_came_to_nothing_makes_room_for_another(tmp_path):
    for checkpoint in ("nowhere", None):
        with open_run_folder(tmp_path, {"seed_model": {"checkpoint": checkpoint}}):
            pass
    assert json.loads((tmp_path / "run.json").read_text()) == {"seed_model": {"checkpoint": None}}


def test_two_commands_do_not_work_in_one_folder_at_once(tmp_path):
    with open_run_folder(tmp_path, {"seed": 0}):
        with (
            pytest.raises(DeuxError, match=f"^another command is using {tmp_path}: wait until it has ended, or"),
            open_run_folder(tmp_path, {"seed": 0}),
        ):
            pass
        assert (tmp_path / "run.json").exists()
    with open_run_folder(tmp_path, {"seed": 0}):
        pass


def test_a_job_of_a_sweep_names_the_option_that_sweeps_follow(tiny, tmp_path):
    """Hydra ignores `hydra.run.dir` there."""
    folders = [f"hydra.sweep.dir={tmp_path}/sweep", "hydra.sweep.subdir=job"]
    with open_run_folder(tmp_path / "sweep/job", {"seed": 0}):
        outcome = tiny(tmp_path, "-m", "task=collect", "explore=random", *folders)
    assert outcome.code == 1
    assert "wait until it has ended, or choose another folder with hydra.sweep.dir=...\n" in outcome.err


def test_seconds_add_up_over_starts_and_survive_an_error(tmp_path, monkeypatch):
    now = iter([10.0, 12.5, 100.0, 101.0])
    monkeypatch.setattr("deux.tasks.run_folder.time.perf_counter", lambda: next(now))
    with pytest.raises(RuntimeError), open_run_folder(tmp_path, {}) as run, run.stage("train"):
        raise RuntimeError
    with open_run_folder(tmp_path, {}) as run:
        with run.stage("train"):
            pass
        assert run.seconds == {"train": 3.5}


def test_equal_content_has_an_equal_hash():
    assert short_hash({"a": 1, "b": [2]}) == short_hash({"b": [2], "a": 1})
    assert short_hash({"a": 1}) != short_hash({"a": 2})


def test_a_refused_command_leaves_the_record_of_the_run_as_it_is(tiny, trained):
    """Hydra writes its own before a task begins: what the report prints would be the refused command."""
    folder = trained / "trained"
    before = {path.name: path.read_bytes() for path in (folder / ".hydra").iterdir()}
    outcome = tiny(trained, "task=train", "explore=random", "training.steps=9", f"hydra.run.dir={folder}")
    assert "contains a run with other settings (training.steps: 2 there, 9 here)" in outcome.sentence
    assert {path.name: path.read_bytes() for path in (folder / ".hydra").iterdir()} == before
    assert b"explore=random" in before["overrides.yaml"]


def test_a_folder_without_work_is_taken_over_with_the_record_of_who_takes_it(tiny, tmp_path):
    (tmp_path / "run/.hydra").mkdir(parents=True)
    (tmp_path / "run/run.json").write_text('{"task": "train"}')
    (tmp_path / "run/.hydra/overrides.yaml").write_text("- seed=7\n")
    outcome = tiny(tmp_path, "task=collect", "explore=random", f"hydra.run.dir={tmp_path}/run")
    assert (outcome.code, outcome.err) == (0, "")
    overrides = yaml.safe_load((tmp_path / "run/.hydra/overrides.yaml").read_text())
    assert overrides[-2:] == ["task=collect", "explore=random"]
    assert yaml.safe_load((tmp_path / "run/.hydra/config.yaml").read_text())["task"] == "collect"
    assert json.loads((tmp_path / "run/run.json").read_text())["task"] == "collect"
