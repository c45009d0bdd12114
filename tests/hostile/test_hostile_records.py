"""What runs, datasets and sweeps leave as JSON, YAML and CSV, wrong on purpose."""

import json
from pathlib import Path

import pytest
import yaml
from hostile import NO_JSON, VALUES, Case, changed_values, damaged_bytes, texts

from deux.collection.pipeline import frame_count
from deux.collection.sparse import SparseSettings
from deux.collection.verification import VerificationSettings, verify_sequences
from deux.figures.training_curves import read_log
from deux.io.layout import SequencePaths
from deux.metrics.scorecard import Scorecard
from deux.report.contents import read_contents
from deux.report.display_names import DisplayNames
from deux.report.results import Results
from deux.report.run_archive import archive_runs
from deux.tasks.active_training import read_rounds
from deux.tasks.prediction_folder import PredictionFolder
from deux.tasks.report import write
from deux.tasks.run_folder import RunFolder, open_run_folder

ERRORS = {"mae": 80.0, "rmse": 180.0, "imae": 70.0, "irmse": 150.0}
IDENTITY = {
    "task": "experiment",
    "seed": 0,
    "camera": {"width": 64, "height": 64},
    "collect": {"steps": 20, "processes": 1, "uncertainty": {"name": "l1"}},
    "training": {"steps": 10, "epochs": 3, "batch_size": 4},
    "evaluation": {"viewpoints": 4, "checkpoint": None, "data": None},
    "explore": {"name": "frontier"},
    "model": {"name": "kbnet", "max_depth": 8},
    "scenes": {"name": "apartments", "train": 4, "test": 2, "draw": 0},
    "robot": {"radius": 0.2},
    "callbacks": {},
}
RESULTS = {
    "model": "kbnet",
    "explore": "frontier",
    "seed": 0,
    "frames": 18,
    "metrics": ERRORS,
    "baseline": ERRORS,
    "constant": ERRORS,
    "seconds": {"training": 3.5},
    "trained": {"weights": "0" * 16, "settings": None},
    "rounds": [{"round": 1, "step": 10, "frames": 4, "area": 3.0, "uncertainty": 0.1, "mae": None}],
    "images": 8,
    "without_truth": 1,
    "without_points": 2,
    "scenes": [{"scene": "hall", "frames": 4, "metrics": ERRORS, "baseline": ERRORS}],
}
SCORECARD = {
    **{"frames": 18, "sampled": 18, "parallax": 0.5, "moved": 0.5, "places": 3, "views": 5, "near": 0.2, "middle": 0.5},
    **{"far": 0.3, "depth_distance": 0.1, "test_shares": {"near": 0.2, "middle": 0.3, "far": 0.5}, "sources": "recent"},
    **{"bumps": 0.1, "actions": 20, "area": 12.0, "floor_share": 0.5, "area_per_action": 0.6},
}
SWEEP = {
    "hydra": {
        "overrides": {"task": ["explore=deux,frontier", "seed=range(0,2)"], "hydra": ["hydra.mode=MULTIRUN"]},
        "sweeper": {"params": {"model": "kbnet"}},
    },
    "task": "experiment",
    "seed": 0,
    "explore": {"name": "deux"},
    "model": {"name": "kbnet"},
}
NAMES = DisplayNames({"kbnet": "KBNet"}, [{"frontier": "Frontier"}])


def finished_run(folder: Path) -> Path:
    """A sweep with one run; gives the run's folder."""
    run = folder / "outputs" / "sweep" / "0"
    (run / ".hydra").mkdir(parents=True)
    (run / "run.json").write_text(json.dumps(IDENTITY))
    (run / "results.json").write_text(json.dumps(RESULTS))
    (run / "scorecard.json").write_text(json.dumps(SCORECARD))
    (run / ".hydra" / "overrides.yaml").write_text("- seed=0\n")
    (run.parent / "multirun.yaml").write_text(yaml.safe_dump(SWEEP))
    (folder / "report" / "tables").mkdir(parents=True)
    return run


def report(folder: Path) -> None:
    """All of a report but its figures."""
    contents = read_contents(folder / "outputs", NAMES, None, (), None)
    write(contents, {}, folder / "report")


def reported(campaign, cases, file: Path) -> None:
    """Run cases on a file of a run; the report's own files are there from the beginning."""
    report(campaign.folder)
    names = {path.name for path in (campaign.folder / "report").rglob("*")}
    for name in ("table1", "table2", "table3", "scorecards", "scorecard"):
        for suffix in ("md", "tex", "csv"):
            (campaign.folder / "report" / "tables" / f"{name}.{suffix}").touch()
    assert {"report.md", "report.html"} <= names
    campaign.run(cases, file, lambda: report(campaign.folder))
    campaign.end()


@pytest.mark.parametrize(
    ("name", "content"), [("results.json", RESULTS), ("run.json", IDENTITY), ("scorecard.json", SCORECARD)]
)
def test_files_of_a_finished_run(campaign, name, content):
    run = finished_run(campaign.folder)
    reported(campaign, [*changed_values(content), *NO_JSON], run / name)


def test_the_composed_configuration(campaign):
    run = finished_run(campaign.folder)
    (run / "run.json").unlink()
    cases = [Case(c.name, yaml.safe_dump(json.loads(c.content)).encode()) for c in changed_values(IDENTITY)]
    report_of = run / ".hydra" / "config.yaml"
    report_of.write_text(yaml.safe_dump(IDENTITY))
    reported(campaign, [*cases, *BAD_YAML], report_of)


def aliases(levels: int) -> str:
    """A YAML file of a few hundred bytes that stands for 10 to the power of `levels` values."""
    lines = ["a0: &a0 [x,x,x,x,x,x,x,x,x,x]"]
    lines += [f"a{k}: &a{k} [{','.join([f'*a{k - 1}'] * 10)}]" for k in range(1, levels)]
    return "\n".join(lines)


BAD_YAML = (
    *texts(
        "",
        "[" * 5000,
        "a: " * 5000,
        aliases(9),
        "task: experiment\nexplore: {name: deux}\n" + aliases(8),
        "&a [*a]",
        "a: &a {b: *a}",
        "- " * 3000,
        "!!python/object/apply:os.system ['touch marker']",
        "task: !!python/name:os.system",
        "? [a, b]\n: c",
        "a: ${oc.env:HOME}",
        "a: ${a}",
        "a: ${nothing}",
        "a: ???",
        "a: \x01",
        "seed: " + "9" * 5000,
        "seed: 1e400",
        "seed: 0x" + "f" * 5000,
        "date: 2026-99-99",
        "<<: [1]",
        "\t",
        "---\na: 1\n---\nb: 2",
    ),
    Case("binary", bytes(range(256))),
)


def test_sweeps_and_overrides(campaign, monkeypatch):
    monkeypatch.chdir(campaign.folder)
    run = finished_run(campaign.folder)
    cases = [Case(c.name, yaml.safe_dump(json.loads(c.content)).encode()) for c in changed_values(SWEEP)]
    commands = (
        "seed=range(0,10**9)",
        "seed=range(0,1000000000)",
        "seed=" + "1," * 5000,
        "=",
        "a={",
        "seed=glob(*)",
        "x" * 9000,
    )
    for command in (
        *commands,
        "seed=range(0,1,0)",
        "explore=choice()",
        "seed=${oc.env:HOME}",
        "+a=[" * 500,
        "seed=1_0,x",
    ):
        changed = {**SWEEP, "hydra": {**SWEEP["hydra"], "overrides": {"task": [command], "hydra": []}}}
        cases.append(Case(command[:30], yaml.safe_dump(changed).encode()))
    reported(campaign, [*cases, *BAD_YAML], run.parent / "multirun.yaml")


def test_overrides_of_a_run(campaign, monkeypatch):
    monkeypatch.chdir(campaign.folder)
    run = finished_run(campaign.folder)
    cases = [
        Case(c.name, yaml.safe_dump(json.loads(c.content)).encode()) for c in changed_values(["seed=0", "explore=deux"])
    ]
    reported(campaign, [*cases, *BAD_YAML], run / ".hydra" / "overrides.yaml")


def test_runs_that_are_kept(campaign):
    run = finished_run(campaign.folder)
    archive_runs(campaign.folder / "outputs", campaign.folder / "kept")
    for file in (run / "results.json", run / "scorecard.json", run.parent / "multirun.yaml"):
        kept = campaign.folder / "kept" / file.relative_to(campaign.folder / "outputs")
        campaign.run(
            [*NO_JSON, *BAD_YAML], kept, lambda: archive_runs(campaign.folder / "outputs", campaign.folder / "kept")
        )
        kept.write_bytes(file.read_bytes())
    campaign.end()


def test_results_alone(campaign):
    file = campaign.folder / "results.json"
    campaign.run(
        [*changed_values(RESULTS), *damaged_bytes(json.dumps(RESULTS).encode())], file, lambda: tables(campaign.folder)
    )
    file = campaign.folder / "scorecard.json"
    campaign.run(changed_values(SCORECARD), file, lambda: Scorecard.load(campaign.folder).entries())
    campaign.end()


def tables(folder: Path) -> None:
    table = Results.load(folder).table()
    table.markdown(), table.latex(), table.csv()


def test_files_of_a_run_that_goes_on(campaign):
    run = campaign.folder / "run"
    run.mkdir()
    (run / "checkpoints").mkdir()

    def work() -> None:
        with open_run_folder(run, IDENTITY) as folder, folder.stage("training"):
            pass

    work()
    good = (run / "seconds.json").read_bytes()
    campaign.run([*changed_values({"training": 3.5, "a": 1}), *NO_JSON], run / "seconds.json", work)
    (run / "seconds.json").write_bytes(good)
    campaign.run([*changed_values(IDENTITY, VALUES[:8]), *NO_JSON], run / "run.json", work)
    (run / "run.json").write_text(json.dumps(IDENTITY))
    (run / "rounds").mkdir()
    done = [{**RESULTS["rounds"][0], "datasets": ["a"]}]
    campaign.run([*changed_values(done), *NO_JSON], run / "rounds" / "rounds.json", lambda: read_rounds(RunFolder(run)))
    campaign.end()


def test_journal_of_predictions(campaign):
    depth = campaign.folder / "depth" / "hall"
    depth.mkdir(parents=True)
    (depth / "0.png").touch()
    record = {
        "sequence": "hall",
        "name": "0",
        "depth": [1, 2, 3],
        "pixels": 3,
        "errors": ERRORS,
        "interpolated": ERRORS,
    }

    def read() -> None:
        found = PredictionFolder(campaign.folder, "png")
        if file := found.write_errors(list(found.records)):
            file.unlink()

    file = campaign.folder / "frames.jsonl"
    whole = json.dumps(record).encode()
    cases = [*changed_values(record), *NO_JSON, Case("cut", whole + b"\n" + whole[:40]), *damaged_bytes(whole)]
    campaign.run(cases, file, read)
    campaign.end()


def test_manifest(campaign):
    counted = {"triplets": 5, "baseline": {"triplets": 4}}
    file = campaign.folder / "manifest.json"
    campaign.run(
        [*changed_values(counted), *NO_JSON],
        file,
        lambda: [frame_count(campaign.folder, choice) for choice in ("recent", "baseline")],
    )
    campaign.end()


def test_verdicts(campaign):
    sequence = campaign.folder / "data" / "hall"
    sequence.mkdir(parents=True)
    (sequence / "image").mkdir()

    def verify() -> None:
        verify_sequences([SequencePaths(sequence)], VerificationSettings(), SparseSettings())

    verify()
    file = sequence / "verification.json"
    verdicts = json.loads(file.read_text())
    judged = {"sources": ["000001"], "rejection": None, "parallax": True}
    verdicts["frames"] = {choice: {"000002": judged} for choice in ("recent", "baseline")}
    campaign.run([*changed_values(verdicts), *NO_JSON], file, verify)
    campaign.end()


def test_logs_of_training(campaign):
    folder = campaign.folder / "version_0"
    folder.mkdir()
    lines = (
        "",
        "step,a\n1,2",
        "step,a\nx,2",
        "a\n1",
        "step,a\n1,x",
        "step,a\n1",
        "step,a\n1,2,3",
        "step\n" + "9" * 5000,
        "\0",
    )
    campaign.run(
        [*texts(*lines), Case("binary", bytes(range(256)))], folder / "metrics.csv", lambda: read_log(campaign.folder)
    )
    (folder / "metrics.csv").unlink()
    (campaign.folder / "version_x").mkdir()
    (campaign.folder / "version_x" / "metrics.csv").write_text("step,a\n1,2")
    campaign.call("version_x", lambda: read_log(campaign.folder))
    campaign.end()


def test_no_files(campaign, special_files):
    run = finished_run(campaign.folder)
    keep = {name: (run / name).read_bytes() for name in ("results.json", "run.json", "scorecard.json")}
    for special in special_files(".json")[:4]:
        for name, content in keep.items():
            (run / name).unlink()
            (run / name).symlink_to(special)
            campaign.call(
                f"{name} is {special.name}", lambda: read_contents(campaign.folder / "outputs", NAMES, None, (), None)
            )
            (run / name).unlink()
            (run / name).write_bytes(content)
    campaign.end()
