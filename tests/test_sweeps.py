"""Sweeps whose jobs run in processes of their own, by each launcher that is installed."""

import json
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

LAUNCHERS = {"joblib": "hydra_joblib_launcher", "submitit_local": "hydra_submitit_launcher"}

SMALLEST = [
    "experiment=debug",
    "scenes.validation=0",
    "collect.steps=8",
    "seed_model.steps=2",
    "training.steps=2",
    "evaluation.viewpoints=2",
    "trainer.accelerator=cpu",
    "model.image_filters=[4,8,8,8,8]",
    "model.depth_filters=[4,4,4,4,4]",
    "model.decoder_filters=[8,8,8,8,4]",
]


def sweep(folder: Path, launcher: str, *overrides: str) -> subprocess.CompletedProcess[str]:
    if launcher in LAUNCHERS:
        pytest.importorskip(f"hydra_plugins.{LAUNCHERS[launcher]}")
    command = [sys.executable, "-m", "deux", "-m", f"hydra/launcher={launcher}", *SMALLEST, *overrides]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def told(folder: Path) -> str:
    """All that the jobs' log files say."""
    return "".join(path.read_text() for path in folder.glob("outputs/sweeps/*/*/deux.log"))


def test_two_jobs_at_a_time_share_the_frames_and_the_seed_model(tmp_path):
    overrides = ["explore=frontier", "seed=0", "training.learning_rate=1e-4,2e-4"]
    result = sweep(tmp_path, "joblib", "hydra.launcher.n_jobs=2", *overrides)
    assert result.returncode == 0, result.stderr
    runs = list(tmp_path.glob("outputs/sweeps/*/kbnet-frontier-*"))
    assert len(runs) == 2
    assert all(json.loads((run / "results.json").read_text()) for run in runs)
    collected = Counter(re.findall(r"collecting (\w+)-", told(tmp_path)))
    assert collected == {"frontier": 1, "test": 1}
    assert not list(tmp_path.glob("outputs/**/*.lock.json*"))
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("outputs/**/results.json")}
    assert sweep(tmp_path, "joblib", "hydra.launcher.n_jobs=2", *overrides).returncode == 0
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.glob("outputs/**/results.json")}


def test_a_job_that_fails_in_another_process_is_told_here_and_the_others_go_on(tmp_path):
    overrides = ["explore=random", "task=collect", "camera.hfov=90,500"]
    result = sweep(tmp_path, "joblib", "hydra.launcher.n_jobs=2", *overrides)
    assert result.returncode == 1
    sentence, last = result.stderr.splitlines()[-2:]
    assert re.match(r"deux: \[.*camera\.hfov=500.*\] camera\.hfov", sentence)
    assert last.startswith("deux: a job of the sweep failed, perhaps not this one alone: ")
    assert "Traceback" not in result.stderr
    assert len(list(tmp_path.glob("outputs/datasets/random-*"))) == 1


@pytest.mark.slow
def test_jobs_of_submitit_run_here_too(tmp_path):
    result = sweep(tmp_path, "submitit_local", "explore=random", "task=collect", "seed=0,1")
    assert result.returncode == 0, result.stderr
    assert len(list(tmp_path.glob("outputs/datasets/random-*"))) == 2


def test_a_launcher_that_is_not_installed_is_named_with_its_extra(tmp_path, monkeypatch):
    from hydra.errors import MissingConfigException

    from deux.composition_errors import composition_error

    for name, extra in {"joblib": "joblib", "submitit_slurm": "slurm"}.items():
        missing = MissingConfigException("no", f"hydra/launcher/{name}", ["basic"])
        expected = f"hydra/launcher={name} is not installed: pip install 'deux[{extra}]'."
        assert str(composition_error(missing)) == expected
