"""The paper's sweeps and the report over them, as a user runs them."""

import csv
import json
import shutil
from pathlib import Path

import pytest
import yaml

from deux.configuration import compose, config_folder
from deux.registry import registry
from deux.tasks.report import explorer_presets


def preset(name: str) -> dict:
    return yaml.safe_load((config_folder() / "experiment" / f"{name}.yaml").read_text())


@pytest.mark.parametrize("name", ["table1", "table2", "table3"])
def test_the_presets_sweep_over_what_there_is_in_the_papers_order(name):
    params = preset(name)["hydra"]["sweeper"]["params"]
    report = compose().report
    order = [explorer for part in report.explorers for explorer in part if explorer != "viewpoints"]  # not the paper's
    explorers = params["explore"].split(",")
    assert explorers == (["random", "deux"] if name == "table2" else order)
    assert params["model"].split(",") == list(report.models)
    assert set(report.models) <= set(registry().names("depth_models"))
    assert set(explorers) - {"oracle"} <= set(registry().names("explorers"))
    assert len(params["seed"].split(",")) >= 3


def test_a_scale_gives_way_to_the_scenes_and_the_command_line_to_nothing():
    cfg = compose(["experiment=table2", "scale=gpu", "camera.hfov=80", "model=voiced"])
    assert (cfg.camera.width, cfg.camera.hfov, cfg.robot.camera_height) == (256, 80, 0.4)
    assert (cfg.scenes.train, cfg.training.steps, cfg.training.learning_rate) == (16, 10000, 2e-4)
    assert compose(["experiment=table3", "scenes=files", "scale=paper"]).scenes.train == []
    assert compose(["model=voiced", "scale=paper"]).training.learning_rate == 1e-4
    assert compose(["experiment=debug", "scenes=files"]).scenes.test == []
    assert compose(["scale=laptop"]) == compose()


def test_presets_of_explorers_are_known_by_their_options():
    """What `explore=deux_paper` sets otherwise than `explore=deux`: the walk, the measure and the map."""
    presets = explorer_presets()
    assert list(presets) == ["deux_paper"]
    options = dict(presets["deux_paper"])
    assert options["explore.residual_pose"] == '"pose"'
    assert (options["collect.uncertainty"], options["collect.correct_depth"]) == ('"l1"', "false")
    assert options["explore.target"] == '"sampled"'
    assert "explore.motion" not in options  # arcs, as by default


def test_a_report_changes_no_runs_name():
    from deux.configuration import run_id

    assert run_id(compose(["report.runs=a"])) == run_id(compose())
    reports = [run_id(compose(["task=report", f"report.runs={runs}"])) for runs in "ab"]
    assert len(set(reports)) == 2
    assert all(name.startswith("report-") for name in reports)


def results(outputs: Path) -> dict[str, dict]:
    return {path.parent.name: json.loads(path.read_text()) for path in outputs.glob("sweeps/*/*/results.json")}


@pytest.mark.slow  # nine runs; tests/report looks at tables and pages
@pytest.mark.timeout(900)
def test_three_sweeps_become_three_tables(tiny, deux, tmp_path):
    def sweep(name: str, *overrides: str):
        return tiny(tmp_path, f"experiment={name}", *overrides, f"hydra.sweep.dir={tmp_path}/sweeps/{name}")

    def report() -> tuple[Path, str]:
        outcome = deux("task=report", f"report.runs={tmp_path}", f"hydra.run.dir={tmp_path}/report")
        assert (outcome.code, outcome.err) == (0, "")
        return tmp_path / "report", outcome.out

    first = ("table1", "explore=random,frontier", "seed=0,1")
    assert sweep(*first).code == 0
    whole = results(tmp_path)
    assert len(whole) == 4

    # a sweep that was stopped
    lost = next(name for name, found in whole.items() if (found["explore"], found["seed"]) == ("frontier", 1))
    shutil.rmtree(tmp_path / "sweeps" / "table1" / lost)
    folder, said = report()
    assert "3 finished runs, 1 missing" in said
    assert "missing: Frontier, KBNet: seed 1" in said
    assert "Frontier, KBNet: seed 1" in (folder / "report.html").read_text()
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("sweeps/*/*/results.json")}
    assert sweep(*first).code == 0
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert results(tmp_path)[lost]["metrics"] == pytest.approx(whole[lost]["metrics"], rel=1e-6)

    # another dataset, and the models of the first one on it
    assert sweep("table2", "explore=random", "seed=0").code == 0
    third = ("table3", "explore=random,frontier", "seed=0,1", f"evaluation.checkpoint={tmp_path}/sweeps")
    assert sweep(*third).code == 0
    transferred = [found for found in results(tmp_path).values() if found.get("trained")]
    assert len(transferred) == 4
    for found in transferred:
        trained = found["trained"]["settings"]
        (own,) = (
            r for r in whole.values() if (r["explore"], r["seed"]) == (trained["explore"]["name"], trained["seed"])
        )
        assert found["metrics"] != own["metrics"]
        assert "camera_height" not in trained["robot"]
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("sweeps/table3/*/results.json")}
    assert sweep(*third).code == 0
    assert before == {path: path.stat().st_mtime_ns for path in before}

    folder, said = report()
    assert "9 finished runs, 0 missing" in said
    low = "apartments (camera.hfov=70, robot.camera_height=0.4)"
    for title in (
        "Table I: Depth completion on the apartments test set: 4 runs",
        f"Table II: Depth completion on the {low} test set: 1 run",
        f"Table III: Zero-shot transfer: trained on apartments, tested on {low}: 4 runs",
    ):
        assert title in said
    assert {path.name for path in (folder / "tables").iterdir()} == {
        f"{name}.{suffix}"
        for name in ("table1", "table2", "table3", "scorecards", "scorecards_2")
        for suffix in ("md", "tex", "csv")
    }
    assert "## Scorecards" in (folder / "report.md").read_text()
    with (folder / "tables" / "table1.csv").open(newline="") as file:
        lines = {line["exploration"]: line for line in csv.DictReader(file)}
    maes = [found["metrics"]["mae"] for found in whole.values() if found["explore"] == "random"]
    assert float(lines["Random"]["mae [mm] mean"]) == pytest.approx(sum(maes) / 2)
    assert float(lines["Random"]["mae [mm] interval"]) == pytest.approx(12.7062 * abs(maes[0] - maes[1]) / 2, rel=1e-4)
    page = (folder / "report.html").read_text()
    assert page.count("data:image/jpeg") == 3  # test frames: two explorers, and one on the other dataset
    assert page.count("data:image/png") == 2  # trajectories of two datasets
    assert "Random*" in (folder / "tables" / "table2.md").read_text().replace("\\", "")


def test_several_models_that_fit_are_not_chosen_between(tiny, trained, tmp_path):
    for name in "ab":
        shutil.copytree(trained / "trained", tmp_path / "runs" / name)
    arguments = ("task=evaluate", "explore=random", f"evaluation.checkpoint={tmp_path}/runs")
    sentence = tiny(tmp_path, *arguments).sentence
    assert (
        "has 2 trained runs of kbnet on random frames with seed 0 and this budget below it: give the folder" in sentence
    )
    shutil.rmtree(tmp_path / "runs" / "b")
    sentence = tiny(tmp_path, *arguments, "seed=3").sentence
    assert sentence.endswith(
        "has no trained run of kbnet on random frames with seed 3 and this budget below it: train it first."
    )
    sentence = tiny(tmp_path, *arguments, "training.steps=3").sentence
    assert "has no trained run" in sentence


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        ([], "task=report needs runs: set report.runs= to a folder"),
        (["report.runs={tmp}/nothing"], "{tmp}/nothing is not a folder: give one with runs or sweeps below it."),
        (["report.runs={tmp}"], "there is no finished run below {tmp}: a run is finished once it has results.json."),
        (["report.runs=3"], "report.runs must be text or null, but is 3."),
        (["report.runs={tmp}", "report.order=a"], "report.order is not an option of ReportSettings"),
    ],
)
def test_mistakes_are_reported_in_one_sentence(deux, tmp_path, overrides, sentence):
    arguments = [override.format(tmp=tmp_path / "runs") for override in overrides]
    (tmp_path / "runs").mkdir()
    found = deux("task=report", *arguments, f"paths.outputs={tmp_path}/outputs").sentence
    assert found.startswith(sentence.format(tmp=tmp_path / "runs"))


def test_damaged_results_are_reported_in_one_sentence(deux, tmp_path):
    (tmp_path / "runs" / "a").mkdir(parents=True)
    (tmp_path / "runs" / "a" / "results.json").write_text('{"model": "kb')
    found = deux("task=report", f"report.runs={tmp_path}/runs", f"paths.outputs={tmp_path}/outputs").sentence
    assert found.startswith(f"{tmp_path}/runs/a/results.json is not a results file of deux (")
    assert found.endswith("repeat the run.")


def test_kept_runs_are_reported_as_the_runs_are(deux, tmp_path):
    errors = {"mae": 30.0, "rmse": 90.0, "imae": 20.0, "irmse": 60.0}
    results = {"model": "kbnet", "explore": "random", "seed": 0, "frames": 18, "seconds": {"train": 1.5}}
    run = tmp_path / "outputs" / "runs" / "a"
    run.mkdir(parents=True)
    (run / "results.json").write_text(
        json.dumps({**results, **dict.fromkeys(("metrics", "baseline", "constant"), errors)})
    )
    outcome = deux(
        "task=report",
        f"report.runs={tmp_path}/outputs",
        f"report.keep={tmp_path}/kept",
        f"hydra.run.dir={tmp_path}/first",
    )
    assert f"Copied the small files of 1 run to {tmp_path}/kept" in outcome.out
    assert deux("task=report", f"report.runs={tmp_path}/kept", f"hydra.run.dir={tmp_path}/second").code == 0
    tables = [(tmp_path / name / "tables" / "table1.csv").read_text() for name in ("first", "second")]
    assert tables[0] == tables[1]
    assert "30.0" in tables[0]
