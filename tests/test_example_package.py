"""The example in docs/ is a real package: it is installed here and used as a third party's would be."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from deux.configuration import compose
from deux.plugin_kinds import KINDS
from deux.registry import registry

EXAMPLE = Path(__file__).resolve().parents[1] / "docs" / "examples" / "deux-example"
PLUGINS = {
    "explorers": "wall_follower",
    "rewards": "new_floor",
    "depth_models": "pooled_network",
    "losses": "second_order_smoothness",
    "uncertainties": "interpolation_gap",
    "simulators": "noisy_depth",
    "scenes": "box_rooms",
    "readers": "tum_rgbd",
}
OVERRIDES = ["explore=wall_follower", "model=pooled_network", "objective.second_order_smoothness=0.1"]


@pytest.fixture(scope="module")
def site(installed_copy: Callable[[Path], Path]) -> Path:
    """A folder into which the example is installed, from a copy."""
    return installed_copy(EXAMPLE)


@pytest.fixture
def installed(site: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(str(site))
    registry.cache_clear()
    yield
    registry.cache_clear()


def python(site: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )


def test_its_plugins_are_listed_with_their_package(site: Path, tmp_path: Path) -> None:
    rows = python(site, tmp_path, "-m", "deux.plugins").stdout.splitlines()
    for kind, name in PLUGINS.items():
        assert f"{KINDS[kind].noun}\t{name}\tdeux-example\t0.1.0" in rows


@pytest.mark.usefixtures("installed")
def test_its_plugins_are_composed_and_made_without_any_yaml() -> None:
    cfg = compose([*OVERRIDES, "explore.distance=1", "model.channels=4"])
    assert set(PLUGINS) == set(KINDS)
    for kind, name in PLUGINS.items():
        assert registry().get(kind, name).__module__.startswith("deux_example.")
    explorer = registry().create("explorers", cfg.explore.name, cfg.explore)
    model = registry().create("depth_models", cfg.model.name, cfg.model)
    term = registry().create("losses", "second_order_smoothness", {"sharpness": 2})
    assert (explorer.distance, model.max_depth, term.sharpness) == (1.0, 10.0, 2.0)
    assert {type(plugin).__module__ for plugin in (explorer, model, term)} == {
        "deux_example.wall_follower",
        "deux_example.pooled_network",
        "deux_example.second_order_smoothness",
    }


@pytest.mark.slow
def test_its_own_tests_pass(site: Path) -> None:
    result = python(site, EXAMPLE, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist")
    assert result.returncode == 0, result.stdout


SMALLEST = ["experiment=smallest", "scenes.train=1", "training.steps=2"]
"""As little as every stage can do."""

NO_NETWORK = [f"~model.{name}" for name in ("image_filters", "depth_filters", "decoder_filters")]
"""Takes back what that experiment says of another model."""


@pytest.fixture
def deux(
    command_line: Callable[..., int], installed: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., int]:
    """Run the smallest command inside this process, in the test's folder: deux(*arguments)."""
    monkeypatch.chdir(tmp_path)
    return partial(command_line, *SMALLEST)


def test_its_scenes_simulator_and_measure_guide_the_robot(
    deux: Callable[..., int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    chosen = ["simulator=noisy_depth", "scenes=box_rooms", "collect.uncertainty=interpolation_gap"]
    assert deux("task=collect", "explore=deux", *chosen) == 0, capfd.readouterr().err
    (path,) = tmp_path.glob("outputs/datasets/deux-*/manifest.json")
    made_by = json.loads(path.read_text())["specification"]
    assert made_by["simulator"]["name"] == "noisy_depth"
    assert made_by["uncertainty"]["name"] == "interpolation_gap"


def test_the_whole_experiment_runs_with_it(
    deux: Callable[..., int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert deux(*OVERRIDES, *NO_NETWORK) == 0, capfd.readouterr().err
    (path,) = tmp_path.glob("outputs/runs/pooled_network-wall_follower-*/results.json")
    results = json.loads(path.read_text())
    assert (results["model"], results["explore"]) == ("pooled_network", "wall_follower")
