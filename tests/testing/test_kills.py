"""A short campaign of kills; `python -m deux.testing.kills` is the long one (docs/reliability.md)."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from deux.testing.kill_scenarios import SCENARIOS
from deux.testing.kills import main


def campaign(folder: Path, kills: int, *scenarios: str) -> list[dict]:
    """Run a campaign; what it counted."""
    options = ["--kills", str(kills), "--json", str(folder / "counts.json"), "--folder", str(folder / "kills")]
    process = subprocess.run(
        [sys.executable, "-m", "deux.testing.kills", *scenarios, *options],
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stdout + process.stderr
    return json.loads((folder / "counts.json").read_text())


def test_a_collection_that_is_killed_twice_ends_like_an_unbroken_one(tmp_path):
    """Once before a file is moved into its place, and once after it."""
    (count,) = campaign(tmp_path, 2, "collect")
    assert count["kills"] == count["restarts"] == 2
    assert count["differences"] == []
    assert list((tmp_path / "kills/killed/outputs/datasets").glob("*/manifest.json"))


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("scenario", [name for name, scenario in SCENARIOS.items() if scenario.installed])
def test_a_command_that_is_killed_twenty_times_ends_like_an_unbroken_one(tmp_path, scenario):
    (count,) = campaign(tmp_path, 20, scenario)
    assert count["kills"] >= 20
    assert count["differences"] == []


def test_an_unknown_scenario_is_told_in_one_sentence(capsys):
    assert main(["colect"]) == 1
    assert capsys.readouterr().err.startswith("deux: there is no scenario 'colect': did you mean collect? There is: ")
