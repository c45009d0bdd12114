"""The smallest experiment that goes through every stage, run as a user would run it."""

import subprocess
import sys
from pathlib import Path

import pytest

SMALLEST = [
    "camera.width=48",
    "camera.height=48",
    "scenes.train=2",
    "scenes.validation=0",
    "scenes.test=1",
    "collect.steps=16",
    "seed.steps=6",
    "training.steps=6",
    "training.validations=1",
    "evaluation.viewpoints=2",
]


@pytest.fixture(scope="session")
def command():
    """The command line of the smallest experiment, with further overrides: command(outputs, "explore=random", ...)."""

    def make(outputs: Path, *overrides: str) -> list[str]:
        folders = [f"paths.outputs={outputs}", f"hydra.run.dir={outputs}/run"]
        return [sys.executable, "-m", "deux", *SMALLEST, *folders, *overrides]

    return make


@pytest.fixture(scope="session")
def experiment(command):
    """Run the smallest experiment to its end: experiment(outputs, *overrides) gives the finished process."""

    def run(outputs: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(command(outputs, *overrides), capture_output=True, text=True)

    return run


@pytest.fixture(scope="session")
def finished(experiment, tmp_path_factory) -> Path:
    """The outputs folder of an uninterrupted experiment with deux."""
    outputs = tmp_path_factory.mktemp("uninterrupted")
    process = experiment(outputs, "explore=deux")
    assert process.returncode == 0, process.stderr
    return outputs
