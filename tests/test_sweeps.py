"""Sweeps whose jobs run in processes of their own, by each launcher that is installed."""

import json
import logging
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest
from hydra.errors import MissingConfigException
from hydra.experimental.callback import Callback

import deux.__main__ as command_line
from deux.composition_errors import composition_error
from deux.configuration import _sweep_id

LAUNCHERS = {"joblib": "hydra_joblib_launcher", "submitit_local": "hydra_submitit_launcher"}

SMALLEST = [
    "experiment=debug",
    "scenes.validation=0",
    "collect.steps=8",
    "seed_model.steps=2",
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


@pytest.mark.slow
def test_two_jobs_at_a_time_share_frames_and_seed_model_and_outlive_a_third_that_fails(tmp_path):
    def run() -> list[str]:
        steps = "training.steps=2,3,0"  # which the seed model does not depend on
        result = sweep(tmp_path, "joblib", "hydra.launcher.n_jobs=2", "explore=deux", steps)
        assert result.returncode == 1
        assert "Traceback" not in result.stderr
        return result.stderr.splitlines()[-2:]

    sentence, last = run()
    assert re.match(r"deux: \[.*training\.steps=0.*\] training\.steps", sentence)
    assert last.startswith("deux: a job of the sweep failed, perhaps not this one alone: ")
    runs = list(tmp_path.glob("outputs/sweeps/*/kbnet-deux-*/results.json"))
    assert len(runs) == 2
    assert all(json.loads(run.read_text()) for run in runs)
    assert Counter(re.findall(r"collecting (\w+)-", told(tmp_path))) == {"random": 1, "deux": 1, "test": 1}
    assert told(tmp_path).count(f"training {tmp_path}/outputs/seed_models/kbnet-") == 1
    assert not list(tmp_path.glob("outputs/**/.*.json*"))  # no lock stays behind

    before = {run: run.stat().st_mtime_ns for run in runs}
    assert run()[0] == sentence
    assert before == {run: run.stat().st_mtime_ns for run in runs}  # a finished run is taken as it is


@pytest.mark.slow
def test_jobs_of_submitit_run_here_too(tmp_path):
    result = sweep(tmp_path, "submitit_local", "explore=random", "task=collect", "seed=0,1")
    assert result.returncode == 0, result.stderr
    assert len(list(tmp_path.glob("outputs/datasets/random-*"))) == 2


def test_a_sweep_has_one_folder_whatever_launches_its_jobs(monkeypatch):
    def folder(*arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", ["deux", "-m", *arguments])
        return _sweep_id()

    alone = folder("seed=0,1")
    assert folder("hydra/launcher=ray", "+hydra.launcher.ray.init.address=local", "seed=0,1") == alone
    assert folder("collect.processes=2", "data.cache=none", "training.num_workers=0", "seed=0,1") == alone
    assert folder("seed=0,1", "paths.outputs=/moved/outputs") == alone
    assert folder("seed=0,2") != alone
    grids = [folder(f"hydra.sweeper.params.seed={seeds}") for seeds in ("'0,1'", "'0,2'")]
    assert grids[0] != grids[1]


def test_a_sweep_in_one_process_keeps_no_configuration_of_its_jobs(monkeypatch, tmp_path):
    """Hydra's launcher would keep two for each job, a quarter of a MiB, until the sweep is done."""
    kept, ran = [], []

    class Keeping(Callback):
        def on_job_end(self, config, job_return, **_):
            kept.append(job_return)

    monkeypatch.setitem(sys.modules, "keeping", SimpleNamespace(Keeping=Keeping))
    monkeypatch.setattr(command_line, "run_task", lambda cfg: ran.append(cfg.seed))
    keeping = "+hydra.callbacks.keeping={_target_:keeping.Keeping}"
    monkeypatch.setattr(sys, "argv", ["deux", "-m", "seed=3,4", f"paths.outputs={tmp_path}", keeping])
    monkeypatch.setattr(logging.root, "handlers", [])
    assert command_line.main() == 0
    assert ran == [3, 4]
    assert [(one.cfg, one.hydra_cfg, one.overrides[0]) for one in kept] == [(None, None, f"seed={n}") for n in ran]


def test_a_launcher_that_is_not_installed_is_named_with_its_extra():
    for name, extra in {"joblib": "joblib", "submitit_slurm": "slurm"}.items():
        missing = MissingConfigException("no", f"hydra/launcher/{name}", ["basic"])
        expected = f"hydra/launcher={name} is not installed: pip install 'deux[{extra}]'."
        assert str(composition_error(missing)) == expected
