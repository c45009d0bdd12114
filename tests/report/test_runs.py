import json

import pytest

from deux.errors import DeuxError
from deux.report.runs import find_runs


def test_runs_are_found_wherever_they_lie(write_run, outputs):
    write_run("deux", "kbnet", 0, 10.0, folder="sweeps/abc", overrides=("model=kbnet",))
    write_run("deux", "kbnet", 1, None, folder="sweeps/abc")
    write_run("random", "kbnet", 0, 20.0, folder="runs")
    (outputs / "datasets" / "random-1").mkdir(parents=True)
    (outputs / "datasets" / "random-1" / "manifest.json").write_text("{}")
    other = write_run("deux", "kbnet", 7, 1.0, folder="runs", task="compare_explorers")
    (other / "results.json").write_text('{"explorers": 3}')
    (outputs / "seed_models" / "kbnet-1").mkdir(parents=True)
    (outputs / "seed_models" / "kbnet-1" / "run.json").write_text('{"dataset": "random-1"}')
    found = find_runs(outputs)
    assert [run.path.name for run in found.finished] == ["kbnet-random-0", "kbnet-deux-0"]
    assert found.finished[1].overrides == ("model=kbnet",)
    assert [run.path.name for run in found.unfinished] == ["kbnet-deux-1"]
    assert find_runs(outputs / "runs" / "kbnet-random-0").finished == found.finished[:1]


def test_what_an_evaluation_was_trained_on_is_read_from_its_results(write_run, outputs, here, there):
    write_run("deux", "kbnet", 2, 10.0, place=there, trained_in=here)
    write_run("deux", "kbnet", 2, 10.0, place=here, trained_in=here, name="at_home")
    at_home, away = find_runs(outputs).finished
    assert (away.conditions.explorer, away.conditions.model, away.conditions.seed) == ("deux", "kbnet", 2)
    assert ("scenes.train", "4") in away.conditions.training
    assert ("scenes.test", '["x/hall.ply"]') in away.conditions.testing
    assert away.own_testing == at_home.conditions.testing


def test_results_without_any_configuration_are_read(write_run, outputs):
    path = write_run("deux", "kbnet", 3, 10.0)
    (path / "run.json").unlink()
    (run,) = find_runs(outputs).finished
    assert (run.conditions.explorer, run.conditions.model, run.conditions.seed) == ("deux", "kbnet", 3)
    (path / ".hydra" / "config.yaml").write_text("{task: experiment, explore: {name: deux}, camera: {width: 8}}")
    (run,) = find_runs(outputs).finished
    assert ("camera.width", "8") in run.conditions.testing


def test_what_fits_into_no_table_is_reported(write_run, outputs):
    path = write_run("deux", "kbnet", 0, 10.0, task="evaluate")
    given = write_run("deux", "kbnet", 1, 10.0, training_data="void")
    reasons = dict(find_runs(outputs).left_out)
    assert reasons[path] == "the training data of its model are unknown"
    assert "recorded frames" in reasons[given]


@pytest.mark.parametrize(
    ("file", "content", "sentence"),
    [
        ("results.json", "{", "is not a results file of deux"),
        ("results.json", "[]", "is not a results file of deux"),
        ("results.json", '{"metrics": {}}', "is not a results file of deux"),
        ("results.json", b"\xff\xfe", "is not a results file of deux"),
        ("run.json", "{", "the configuration of the run"),
        ("run.json", "3", "the configuration of the run"),
        ("run.json", '{"model": 3}', "the configuration of the run"),
    ],
)
def test_damaged_files_get_a_sentence(write_run, outputs, file, content, sentence):
    path = write_run("deux", "kbnet", 0, 10.0) / file
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(DeuxError, match=sentence) as caught:
        find_runs(outputs)
    assert str(path.parent) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_metric_that_is_no_number(write_run, outputs):
    path = write_run("deux", "kbnet", 0, 10.0) / "results.json"
    content = json.loads(path.read_text())
    content["metrics"]["rmse"] = None
    path.write_text(json.dumps(content))
    with pytest.raises(DeuxError, match="metrics must be names, each with a number"):
        find_runs(outputs)


def test_folders_without_runs(tmp_path, write_run, outputs):
    with pytest.raises(DeuxError, match=r"nothing is not a folder: give one"):
        find_runs(tmp_path / "nothing")
    with pytest.raises(DeuxError, match=r"^there is no finished run below .*: a run is finished once"):
        find_runs(tmp_path)
    write_run("deux", "kbnet", 0, None)
    with pytest.raises(DeuxError, match=r"1 unfinished"):
        find_runs(outputs)


def test_what_somebody_elses_configuration_refers_to_stays_text(write_run, outputs, monkeypatch):
    monkeypatch.setenv("DEUX_SECRET", "the secret")
    path = write_run("deux", "kbnet", 3, 10.0)
    (path / "run.json").unlink()
    (path / ".hydra" / "config.yaml").write_text(
        """
        task: experiment
        seed: 3
        kind: oc.env
        explore: {name: "${oc.env:DEUX_SECRET}", hidden: "${${kind}:DEUX_SECRET}", joined: "${oc.env:DEUX_SECRET}/a"}
        model: {name: "${explore.name}", min_depth: "${model.min_depth}"}
        scenes: {draw: "${seed}"}
        """
    )
    (run,) = find_runs(outputs).finished
    assert run.conditions.explorer == "${oc.env:DEUX_SECRET}"
    assert "secret" not in str(run).replace("DEUX_SECRET", "").lower()
    assert ("scenes.draw", '"seed"') in run.conditions.training  # a reference to another option is followed
