"""Runs as a sweep leaves them, written by hand with errors that are known."""

import json
import os
from pathlib import Path

import pytest
import yaml

from deux.report.display_names import DisplayNames

HERE = {"scenes": {"name": "apartments", "train": 4, "test": 2}, "robot": {}}
THERE = {"scenes": {"name": "files", "train": ["a.glb"], "test": ["x/hall.ply"]}, "robot": {}}
BASELINE = {"mae": 80.0, "rmse": 180.0, "imae": 70.0, "irmse": 150.0}


def identity(explorer: str, model: str, seed: int, place: dict = HERE, **changes) -> dict:
    chosen = {
        "task": "experiment",
        "seed": seed,
        "camera": {"width": 64, "height": 64},
        "collect": {"steps": 20, "processes": 1},
        "training": {"steps": 10, "batch_size": 4, "validations": 1},
        "evaluation": {"viewpoints": 4, "checkpoint": None, "data": None},
        "explore": {"name": explorer},
        "model": {"name": model},
        **place,
    }
    for option, value in changes.items():
        node, _, key = option.partition("__")
        chosen[node] = {**chosen.get(node, {}), key: value} if key else value
    return chosen


@pytest.fixture
def there() -> dict:
    """The options of another dataset than runs have by themselves."""
    return THERE


@pytest.fixture
def here() -> dict:
    """The options of the dataset that runs have by themselves."""
    return HERE


@pytest.fixture
def write_run(tmp_path):
    """Write a run: write_run(explorer, model, seed, mae, ...) gives its folder; the MAE makes all its errors."""

    def write(
        explorer: str,
        model: str,
        seed: int,
        mae: float | None,
        place: dict = HERE,
        trained_in: dict | None = None,
        folder: str = "sweep",
        name: str | None = None,
        frames: int = 18,
        overrides: tuple[str, ...] = (),
        **changes,
    ) -> Path:
        made_of = identity(explorer, model, seed, place, **changes)
        trained = None
        if trained_in is not None:
            made_of["task"] = "evaluate"
            trained = {"weights": "0" * 16, "settings": identity(explorer, model, seed, trained_in, **changes)}
        path = tmp_path / "outputs" / folder / (name or f"{model}-{explorer}-{seed}{'-to' * (trained is not None)}")
        (path / ".hydra").mkdir(parents=True)
        (path / "run.json").write_text(json.dumps(made_of))
        (path / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump(list(overrides)))
        if mae is not None:
            found = {
                "model": model,
                "explore": None if trained else explorer,
                "seed": seed,
                "frames": None if trained else frames,
                "metrics": {"mae": mae, "rmse": 2 * mae, "imae": 3 * mae, "irmse": 1000.0 - mae},
                "baseline": BASELINE,
                "constant": BASELINE,
                "seconds": {},
            }
            if trained:
                found["trained"] = trained
            (path / "results.json").write_text(json.dumps(found))
            os.utime(path / "results.json", (seed + 1, seed + 1))
        return path

    return write


@pytest.fixture
def write_sweep(tmp_path):
    """Write what Hydra keeps of a sweep: write_sweep(overrides, params, folder="sweep")."""

    def write(overrides: list[str], params: dict[str, str] | None = None, folder: str = "sweep", **content) -> Path:
        path = tmp_path / "outputs" / folder
        path.mkdir(parents=True, exist_ok=True)
        hydra = {"overrides": {"task": overrides, "hydra": ["hydra.mode=MULTIRUN"]}, "sweeper": {"params": params}}
        chosen = {"task": "experiment", "seed": 0, "explore": {"name": "deux"}, "model": {"name": "kbnet"}}
        (path / "multirun.yaml").write_text(yaml.safe_dump({"hydra": hydra, **chosen, **content}))
        return path

    return write


@pytest.fixture
def names() -> DisplayNames:
    """A few names in an order that is not the alphabet's."""
    models = {"voiced": "VOICED", "kbnet": "KBNet"}
    return DisplayNames(
        models, [{"random": "Random", "frontier": "Frontier"}, {"novelty": "Novelty"}, {"deux": "DEUX"}]
    )


@pytest.fixture
def outputs(tmp_path) -> Path:
    """The folder that has the runs."""
    return tmp_path / "outputs"
