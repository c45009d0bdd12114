"""Reading of sweeps: the grid of explorers, models and seeds in their `multirun.yaml`."""

import itertools
import math
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, RangeSweep

from deux.io.folder_walk import walk
from deux.io.yaml_files import read_yaml
from deux.report.older_configurations import RENAMED_OPTIONS, current_keys
from deux.task_sections import MEANS_NAMES

SWEEP_FILE = "multirun.yaml"
"""File that Hydra writes to a sweep's folder."""

MOST_RUNS = 10_000
"""Maximal number of runs of a sweep in a report."""

GRID = ("explore", "model", "seed")
"""The options of a table's grid: rows, columns, and the seeds of the intervals."""


@dataclass(frozen=True)
class Sweep:
    """The runs of one multirun command.

    Args:
        folder: folder with a subfolder for each run.
        overrides: overrides of the command.
        swept: values of each swept option of `GRID`, including those of the preset.
        fixed: values of the options of `GRID` that were not swept.
        of_checkpoints: whether it evaluates several trained models, whose explorers, models and seeds are not options.
        runs: number of runs of the sweep, over all swept options.
    """

    folder: Path
    overrides: tuple[str, ...]
    swept: dict[str, tuple[str, ...]]
    fixed: dict[str, str]
    of_checkpoints: bool = False
    runs: int = 1

    @property
    def command(self) -> str:
        """The command, which also resumes the sweep."""
        return shlex.join(["python", "-m", "deux", "-m", *self.overrides])

    @property
    def grid(self) -> list[tuple[str, str, int]]:
        """All combinations of explorer, model and seed of the sweep; empty if the command does not contain them."""
        if self.of_checkpoints and not self.swept:
            return []
        values = [self.swept.get(option) or (self.fixed[option],) for option in GRID]
        return [(explorer, model, int(seed)) for explorer, model, seed in itertools.product(*values)]


def find_sweeps(folder: Path) -> list[Sweep]:
    """The sweeps of experiments and evaluations at or below a folder.

    Files that cannot be read as a sweep, such as those of sweepers without a fixed grid, are skipped.
    """
    sweeps = []
    for path in _sweep_folders(folder):
        try:
            sweep = _read(path)
        except Exception:  # values may have any type, on which parsing fails in many ways
            continue
        if sweep is not None:
            sweeps.append(sweep)
    return sweeps


def sweep_file(folder: Path) -> dict[str, Any]:
    """The part of a sweep's `multirun.yaml` that `find_sweeps` reads."""
    content = read_yaml(folder / SWEEP_FILE)
    hydra, options = content["hydra"], current_keys(content)
    overrides = {name: hydra["overrides"][name] for name in ("task", "hydra")}
    return {
        "hydra": {"overrides": overrides, "sweeper": {"params": hydra["sweeper"].get("params")}},
        "task": content["task"],
        "explore": {"name": options["explore"]["name"]},
        "model": {"name": options["model"]["name"]},
        "seed": options["seed"],
    }


def _sweep_folders(folder: Path) -> Iterator[Path]:
    for path, subfolders, files in walk(folder):
        if SWEEP_FILE in files:
            subfolders.clear()
            yield path
        elif "manifest.json" in files:
            subfolders.clear()


def _read(folder: Path) -> Sweep | None:
    content = read_yaml(folder / SWEEP_FILE)
    if content["task"] not in ("experiment", "evaluate"):
        return None
    hydra = content["hydra"]
    overrides = [str(override) for override in hydra["overrides"]["task"]]
    folders = [str(override) for override in hydra["overrides"]["hydra"] if not str(override).startswith("hydra.mode")]
    preset = [f"{key}={value}" for key, value in (hydra["sweeper"].get("params") or {}).items()]
    swept = {}
    for override in OverridesParser.create().parse_overrides([*preset, *overrides]):  # later ones win, as in Hydra
        option = override.get_key_element()
        values = _swept_values(override) if override.is_sweep_override() else (_value(override),)
        swept[RENAMED_OPTIONS.get(option, option)] = values
    options = current_keys(content)
    fixed = {"explore": options["explore"]["name"], "model": options["model"]["name"], "seed": options["seed"]}
    sweep = Sweep(
        folder=folder,
        overrides=(*overrides, *folders),
        swept={option: swept[option] for option in GRID if option in swept},
        fixed={option: str(value) for option, value in fixed.items()},
        of_checkpoints=len(swept.get("evaluation.checkpoint", ())) > 1,
        runs=math.prod(len({*values}) for option, values in swept.items() if option not in MEANS_NAMES),
    )
    if math.prod(map(len, sweep.swept.values())) > MOST_RUNS:
        raise ValueError(f"it has more than {MOST_RUNS} runs")
    sweep.grid  # noqa: B018 - raises ValueError for seeds that are not numbers
    return sweep


def _swept_values(override: Override) -> tuple[str, ...]:
    """The values of a swept option; raises ValueError if there are more than `MOST_RUNS`."""
    values = override.value()
    if isinstance(values, RangeSweep):
        distance = (values.stop or 0) - (values.start or 0)
        if abs(distance) > MOST_RUNS * abs(values.step):
            raise ValueError(f"it has more than {MOST_RUNS} values")
    return tuple(override.sweep_string_iterator())


def _value(override: Any) -> str:
    return str(override.get_value_element_as_str())
