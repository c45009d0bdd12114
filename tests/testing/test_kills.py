"""A short campaign of kills; `python -m deux.testing.kills` is the long one (docs/reliability.md)."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from deux.testing.kill_scenarios import SCENARIOS
from deux.testing.kills import main

STUBBED = """
import os, sys, types
from deux.configuration import run_folder
from deux.testing import kills
from deux.testing.kill_scenarios import SCENARIOS, Scenario

def run(cfg):
    if cfg.seed == 1:
        with open("starts", "a") as file:
            file.write("one more")
    for part in range(4):
        if not (run_folder() / str(part)).exists():
            (run_folder() / "part").write_text("whole")
            os.replace(run_folder() / "part", run_folder() / str(part))

task = types.ModuleType("deux.tasks.train")
task.run = run
sys.modules["deux.tasks.train"] = task
for seed, name in enumerate(("careful", "careless")):
    arguments = ["task=train", "explore=random", f"seed={seed}"]
    SCENARIOS[name] = Scenario(lambda folder, arguments=arguments: arguments, prepared=False)
sys.exit(kills.main())
"""
"""A campaign that kills a command whose task does next to nothing; all else is real."""


def campaign(
    folder: Path, kills: int, *scenarios: str, program=("-m", "deux.testing.kills"), code: int = 0
) -> list[dict]:
    """Run a campaign that ends with a code; what it counted."""
    options = ["--kills", str(kills), "--json", str(folder / "counts.json"), "--folder", str(folder / "kills")]
    process = subprocess.run(
        [sys.executable, *program, *scenarios, *options],
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
    assert process.returncode == code, process.stdout + process.stderr
    return json.loads((folder / "counts.json").read_text())


def test_a_campaign_kills_before_and_after_moves_and_finds_what_a_start_leaves_behind(tmp_path):
    careful, careless = campaign(tmp_path, 2, "careful", "careless", program=("-c", STUBBED), code=1)
    assert careful == {"scenario": "careful", "kills": 2, "restarts": 2, "passes": 1, "differences": []}
    assert (careless["kills"], careless["restarts"]) == (2, 2)
    assert [found.split()[2] for found in careless["differences"]] == ["starts"]
    assert len(list((tmp_path / "kills/killed/outputs/runs").glob("*/[0-3]"))) == 4


@pytest.mark.slow
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


def test_an_unknown_scenario_is_reported_in_one_sentence(capsys):
    assert main(["colect"]) == 1
    assert capsys.readouterr().err.startswith("deux: there is no scenario 'colect': did you mean collect? There is: ")
