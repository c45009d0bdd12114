import json
import os
import shutil

import pytest

from deux.errors import DeuxError
from deux.metrics.scorecard import Scorecard
from deux.report.comparable_runs import group_comparable
from deux.report.run_archive import archive_runs
from deux.report.runs import find_runs
from deux.report.sweeps import find_sweeps

ERRORS = {"mae": 123.456, "rmse": 1234.567, "imae": 12.345, "irmse": 123.456}


def groups(folder):
    return group_comparable(find_runs(folder), find_sweeps(folder))


def cells(folder):
    """All that a table is made of: errors by cell and seed, and what is missing."""
    return [
        ({cell: {seed: run.errors for seed, run in runs.items()} for cell, runs in group.cells.items()}, group.missing)
        for group in groups(folder)
    ]


def test_a_report_of_the_copies_is_the_report_of_the_runs(write_run, write_sweep, outputs, tmp_path):
    write_sweep(["explore=random,deux"], {"seed": "0,1"})
    for seed in (0, 1):
        run = write_run("random", "kbnet", seed, 20.0 + seed, overrides=(f"seed={seed}", "paths.outputs=/scratch"))
        (run / "model.deux").write_bytes(b"0" * 100_000)
    archive_runs(outputs, tmp_path / "kept")
    assert cells(tmp_path / "kept") == cells(outputs)
    (group,) = groups(tmp_path / "kept")
    assert {(one.explorer.name, one.seed) for one in group.missing} == {("deux", 0), ("deux", 1)}
    assert group.runs[0].overrides == ("seed=0",)
    assert group.sweeps[0].command == find_sweeps(outputs)[0].command
    assert not list((tmp_path / "kept").rglob("model.deux"))


def test_scorecards_are_kept(write_run, outputs, tmp_path):
    card = Scorecard(18, 18, parallax=0.5, moved=0.4, places=7, views=9, near=0.2, middle=0.5, far=0.3, area=12.5)
    card.save(write_run("random", "kbnet", 0, 20.0))
    archive_runs(outputs, tmp_path / "kept")
    (run,) = find_runs(tmp_path / "kept").finished
    assert run.scorecard == card


def test_a_sweep_in_two_sittings_becomes_one(write_run, outputs, tmp_path):
    kept = tmp_path / "kept"
    first = write_run("random", "kbnet", 0, 20.0)
    archive_runs(outputs, kept)
    shutil.rmtree(first)
    write_run("random", "kbnet", 1, 21.0)
    archive_runs(outputs, kept)
    archive_runs(outputs, kept)  # again changes nothing
    (group,) = groups(kept)
    assert [run.conditions.seed for run in group.finished] == [0, 1]
    assert group.duplicates == 0


def test_what_is_kept_is_not_overwritten_by_another_run(write_run, outputs, tmp_path):
    run = write_run("random", "kbnet", 0, 20.0)
    archive_runs(outputs, tmp_path / "kept")
    results = json.loads((run / "results.json").read_text())
    (run / "results.json").write_text(json.dumps({**results, "seconds": {"train": 9.0}}))
    archive_runs(outputs, tmp_path / "kept")  # another machine's clock makes no other run
    results["metrics"]["mae"] = 25.0
    (run / "results.json").write_text(json.dumps(results))
    with pytest.raises(DeuxError, match=r"exists and is another run than \S+: choose another folder"):
        archive_runs(outputs, tmp_path / "kept")


def test_another_sweep_under_the_same_name_is_refused(write_run, write_sweep, outputs, tmp_path):
    write_run("random", "kbnet", 0, 20.0)
    write_sweep(["seed=0,1"])
    archive_runs(outputs, tmp_path / "kept")
    write_sweep(["seed=0,1,2"])
    with pytest.raises(DeuxError, match="is another sweep"):
        archive_runs(outputs, tmp_path / "kept")


def test_a_run_with_16_scenes_is_small(write_run, outputs, tmp_path):
    run = write_run("random", "kbnet", 0, 20.0)
    scene = {"scene": "house_2200000", "frames": 40, "metrics": ERRORS, "baseline": ERRORS}
    results = json.loads((run / "results.json").read_text())
    (run / "results.json").write_text(json.dumps({**results, "scenes": [scene] * 16}))
    count, size = archive_runs(outputs, tmp_path / "kept")
    assert count == 1
    assert size < 10_000
    files = [file for file in (tmp_path / "kept").rglob("*") if file.is_file()]
    assert size == sum(file.stat().st_size for file in files)


def kept_files(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def test_a_copy_that_was_cut_short_by_a_kill_is_made_again(write_run, outputs, tmp_path, monkeypatch):
    """Killed at each of its moves in turn, and started again."""
    write_run("random", "kbnet", 0, 20.0)
    archive_runs(outputs, tmp_path / "unbroken")
    files = kept_files(tmp_path / "unbroken")
    replace = os.replace
    for move in range(len(files)):
        left = move

        def killed(source, target):
            nonlocal left
            if left == 0:
                raise KeyboardInterrupt
            left -= 1
            replace(source, target)

        folder = tmp_path / str(move)
        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", killed)
            with pytest.raises(KeyboardInterrupt):
                archive_runs(outputs, folder)
        archive_runs(outputs, folder)
        assert kept_files(folder) == files


def test_copies_among_the_runs_themselves_are_refused(write_run, outputs):
    write_run("random", "kbnet", 0, 20.0)
    with pytest.raises(DeuxError, match=r"report\.keep=.*kept is below report\.runs="):
        archive_runs(outputs, outputs / "docs" / "kept")
