"""The grid of explorers, models and seeds that a sweep's `multirun.yaml` asks for."""

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
"""What Hydra keeps of a sweep, in its folder."""

MOST_RUNS = 10_000
"""Runs of a sweep that a report can show."""

GRID = ("explore", "model", "seed")
"""The options that span a table: its rows, its columns, and what its intervals are over."""


@dataclass(frozen=True)
class Sweep:
    """A folder of runs that one command asked for.

    Args:
        folder: holds one folder for each run.
        overrides: the command's.
        swept: the values of each option of `GRID` that was swept over, the preset's included.
        fixed: the values of the options of `GRID` where they were not swept over.
        of_checkpoints: whether it evaluates several models, which say themselves what they are.
        runs: number of runs that were asked for, those included that differ in options that are not of `GRID`.
    """

    folder: Path
    overrides: tuple[str, ...]
    swept: dict[str, tuple[str, ...]]
    fixed: dict[str, str]
    of_checkpoints: bool = False
    runs: int = 1

    @property
    def command(self) -> str:
        """The command that goes on with the sweep."""
        return shlex.join(["python", "-m", "deux", "-m", *self.overrides])

    @property
    def grid(self) -> list[tuple[str, str, int]]:
        """Every explorer, model and seed that was asked for, as far as the command says it."""
        if self.of_checkpoints and not self.swept:
            return []
        values = [self.swept.get(option) or (self.fixed[option],) for option in GRID]
        return [(explorer, model, int(seed)) for explorer, model, seed in itertools.product(*values)]


def find_sweeps(folder: Path) -> list[Sweep]:
    """The sweeps of experiments and evaluations at or below a folder.

    A file that is no sweep's, or of a sweeper whose grid is not known beforehand, is left out.
    """
    sweeps = []
    for path in _sweep_folders(folder):
        try:
            sweep = _read(path)
        except Exception:  # values of any type, which are taken for what Hydra writes
            continue
        if sweep is not None:
            sweeps.append(sweep)
    return sweeps


def sweep_file(folder: Path) -> dict[str, Any]:
    """The part of a sweep's `multirun.yaml` that says what it asked for, which is all that `find_sweeps` reads."""
    content = read_yaml(folder / SWEEP_FILE)
    hydra, chosen = content["hydra"], current_keys(content)
    asked = {name: hydra["overrides"][name] for name in ("task", "hydra")}
    return {
        "hydra": {"overrides": asked, "sweeper": {"params": hydra["sweeper"].get("params")}},
        "task": content["task"],
        "explore": {"name": chosen["explore"]["name"]},
        "model": {"name": chosen["model"]["name"]},
        "seed": chosen["seed"],
    }


def _sweep_folders(folder: Path) -> Iterator[Path]:
    for found, below, files in walk(folder):
        if SWEEP_FILE in files:
            below.clear()
            yield found
        elif "manifest.json" in files:
            below.clear()


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
    chosen = current_keys(content)
    fixed = {"explore": chosen["explore"]["name"], "model": chosen["model"]["name"], "seed": chosen["seed"]}
    sweep = Sweep(
        folder=folder,
        overrides=(*overrides, *folders),
        swept={option: swept[option] for option in GRID if option in swept},
        fixed={option: str(value) for option, value in fixed.items()},
        of_checkpoints=len(swept.get("evaluation.checkpoint", ())) > 1,
        runs=math.prod(len({*values}) for option, values in swept.items() if option not in MEANS_NAMES),
    )
    if math.prod(map(len, sweep.swept.values())) > MOST_RUNS:
        raise ValueError(f"it asks for more than {MOST_RUNS} runs")
    sweep.grid  # noqa: B018 - seeds that are no numbers raise here, and the sweep is left out
    return sweep


def _swept_values(override: Override) -> tuple[str, ...]:
    """The values of an option that is swept over; ValueError where they are more than a table can have."""
    asked = override.value()
    if isinstance(asked, RangeSweep):
        distance = (asked.stop or 0) - (asked.start or 0)
        if abs(distance) > MOST_RUNS * abs(asked.step):
            raise ValueError(f"it asks for more than {MOST_RUNS} values")
    return tuple(override.sweep_string_iterator())


def _value(override: Any) -> str:
    return str(override.get_value_element_as_str())
