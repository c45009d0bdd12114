"""`trainer.strategy=ddp` from the command line, with the published objective, on recorded frames."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOGETHER = ["trainer.strategy=ddp", "trainer.devices=2", "trainer.precision=32-true", "training.batch_size=2"]


@pytest.fixture
def train_together(tiny_arguments):
    """Train in two processes on a dataset: train_together(folder, dataset, *overrides)."""

    def run(folder: Path, dataset: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
        options = ["task=train", f"training_data={dataset}", f"hydra.run.dir={folder}/run", *TOGETHER, *overrides]
        command = [sys.executable, "-m", "deux", *tiny_arguments(folder, *options)]
        alone = {name: value for name, value in os.environ.items() if name not in ("LOCAL_RANK", "WORLD_SIZE")}
        threads = {"OMP_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
        return subprocess.run(command, env=alone | threads, capture_output=True, text=True, timeout=280)

    return run


@pytest.fixture
def recorded(collected, tmp_path) -> Path:
    """A dataset of eight frames that may be changed."""
    (dataset,) = (collected / "datasets").glob("random-*")
    return Path(shutil.copytree(dataset, tmp_path / dataset.name))


def complaints(process: subprocess.CompletedProcess[str]) -> list[str]:
    return [line for line in process.stderr.splitlines() if line.startswith("deux: ")]


@pytest.mark.slow
def test_a_frame_that_one_process_cannot_read_ends_both_with_its_sentence(train_together, recorded, tmp_path):
    (image,) = recorded.glob("data/*/image/000004.png")
    image.write_bytes(image.read_bytes()[:200])
    process = train_together(tmp_path, recorded, "training.steps=9")
    assert process.returncode != 0
    assert "Traceback" not in process.stderr
    found = complaints(process)
    # Which of the two comes to tell it depends on which of them ends first.
    assert found, process.stderr
    assert all("000004.png is truncated" in line for line in found)


@pytest.mark.slow
@pytest.mark.parametrize("pose", ["simulator", "learned"])
def test_two_processes_train_one_model_on_recorded_frames(train_together, recorded, tmp_path, pose):
    process = train_together(tmp_path, recorded, f"pose={pose}", "training.steps=4", "camera.width=96")
    assert process.returncode == 0, process.stderr
    assert complaints(process) == []
    assert (tmp_path / "run/model.safetensors").exists()
    assert json.loads((tmp_path / "run/seconds.json").read_text())
    steps = (tmp_path / "run/logs/version_0/metrics.csv").read_text()
    assert "train/loss" in steps.splitlines()[0]
