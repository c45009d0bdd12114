import hashlib
import json
import math
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
import torch

from deux.metrics.depth_errors import METRICS


def test_everything_that_a_run_leaves_behind(finished):
    run = finished / "run"
    results = json.loads((run / "results.json").read_text())
    assert {key: results[key] for key in ("model", "explore", "seed")} == {
        "model": "kbnet",
        "explore": "deux",
        "seed": 0,
    }
    # Two flats; the first two frames of an episode have source frames after them, one beside a bump may have none.
    manifest = json.loads(next(finished.glob("datasets/deux-*/manifest.json")).read_text())
    assert manifest["baseline"]["candidates"] == 2 * 16
    assert results["frames"] == manifest["baseline"]["triplets"] > 2 * 16 - 4
    for predicted in ("metrics", "corrected", "baseline", "constant"):
        assert tuple(results[predicted]) == tuple(METRICS)
        assert all(math.isfinite(value) and value > 0 for value in results[predicted].values())
    card = json.loads((run / "scorecard.json").read_text())
    assert card["sources"] == "baseline"  # training.sources
    assert card["frames"] == results["frames"]
    assert 0 <= card["depth_distance"] <= 1
    assert card["actions"] == 2 * 16
    assert 0 <= card["bumps"] <= 100
    assert 0 < card["floor_share"] < 1 < card["area"]
    assert set(results["seconds"]) == {"seed", "collect", "train", "evaluate"}
    assert {path.name for path in (run / "figures").iterdir()} == {
        "test_frames.png",
        "training.png",
        "trajectory_apartment_000000-00.png",
        "trajectory_apartment_000001-00.png",
    }
    assert (run / ".hydra" / "config.yaml").exists()
    assert json.loads((run / "run.json").read_text())["model"]["max_pools"] == [23, 27, 29]  # defaults included
    assert list(run.glob("logs/version_0/metrics.csv"))
    assert list(run.glob("logs/version_0/events.*"))


def test_checkpoints_hold_plain_values_only(finished):
    (checkpoint,) = (finished / "run" / "checkpoints").glob("*.ckpt")
    assert torch.load(checkpoint, weights_only=True)["global_step"] == 6


def test_a_finished_run_is_not_run_again(finished, smallest_arguments, deux):
    before = (finished / "run" / "results.json").stat().st_mtime_ns
    outcome = deux(*smallest_arguments(finished, "explore=deux"))
    assert outcome.code == 0
    assert "This run is complete" in outcome.out
    assert (finished / "run" / "results.json").stat().st_mtime_ns == before


def test_a_folder_of_another_run_is_refused(finished, smallest_arguments, deux):
    outcome = deux(*smallest_arguments(finished, "explore=deux", "training.steps=7"))
    assert "training.steps: 6 there, 7 here" in outcome.sentence


def digests(outputs: Path) -> dict[str, str]:
    """A digest of every file of the finished datasets; the manifest's stage times may differ."""
    found = {}
    for path in sorted((outputs / "datasets").glob("[!.]*/**/*")):
        if path.name == "manifest.json":
            content = json.loads(path.read_text()) | {"seconds": None}
            found[str(path.relative_to(outputs))] = json.dumps(content)
        elif path.is_file():
            found[str(path.relative_to(outputs))] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def kill_when(command: list[str], reached, patience: float = 120.0) -> None:
    """Start a command and kill it as soon as `reached()` is true."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    deadline = time.monotonic() + patience
    while not reached():
        assert process.poll() is None, "the run ended before it could be killed"
        assert time.monotonic() < deadline, "the run never came to where it was to be killed"
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_killed_at_three_stages_it_ends_with_the_same_frames_and_the_same_numbers(
    finished, command, experiment, tmp_path
):
    again = command(tmp_path, "explore=deux")

    def frames(explorer: str) -> list[Path]:
        return list(tmp_path.glob(f"datasets/.{explorer}-*.partial/data/*/absolute_pose/0*.txt"))

    kill_when(again, lambda: len(frames("random")) >= 5)
    collected = {path: path.stat().st_mtime_ns for path in frames("random")}
    assert 5 <= len(collected) < 32

    kill_when(again, lambda: list(tmp_path.glob("seed_models/kbnet-*/checkpoints/*.ckpt")))
    dataset = next(tmp_path.glob("datasets/random-*"))
    for path, written in collected.items():
        assert (dataset / path.relative_to(path.parents[3])).stat().st_mtime_ns == written

    kill_when(again, lambda: list(tmp_path.glob("run/checkpoints/*.ckpt")))
    process = experiment(tmp_path, "explore=deux")
    assert process.returncode == 0, process.stderr
    assert digests(tmp_path) == digests(finished)

    mine, theirs = (json.loads((outputs / "run" / "results.json").read_text()) for outputs in (tmp_path, finished))
    assert mine["metrics"] == pytest.approx(theirs["metrics"], rel=1e-6)
