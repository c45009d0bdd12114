"""Benchmark of parallel exploration: steps per second with one process, two processes and Ray."""

import json
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from deux.bench.bench_scenes import default_simulation, flats
from deux.bench.installed_plugins import Guide, installed, make_guide
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.timing import Spread, in_turn, times
from deux.collection.episodes import EpisodePlan
from deux.collection.executors import make_executor
from deux.collection.exploration import explore
from deux.collection.jobs import Executor
from deux.collection.perception import MODEL_NEEDS
from deux.contracts import Need
from deux.errors import DeuxError
from deux.registry import registry

PROCESSES = 2
"""Number of processes that are compared with a single one."""

_WARM_UP = 1 / 3
"""Fraction of the steps after which all processes are assumed to be running."""

_ONE = "one process"


@dataclass(frozen=True)
class ProcessSettings:
    """Settings of the benchmark of parallel exploration.

    Args:
        size: width and height of the images in pixels.
        robots: number of flats, with one robot in each; also the batch size of the depth model.
        steps: number of steps of each robot in a round.
        rounds: number of measurements of each variant.
    """

    size: int = 128
    robots: int = 4
    steps: int = 120
    rounds: int = 3


QUICK = ProcessSettings(steps=40, rounds=1)
"""Settings for a quick test."""


def measure_processes(
    settings: ProcessSettings, model_name: str | None, accelerator: str = "auto"
) -> Iterator[SpeedTable]:
    """Measure exploration with `collect.processes` of 1 and 2, and with `collect.executor=ray` if Ray is installed.

    Measures the first installed explorer that needs a depth model, and the first that needs neither a model nor data
    that a real robot does not have (labels, free space).

    Args:
        settings: the settings of the benchmark.
        model_name: name of the depth model; None for the default of `make_guide`.
        accelerator: Lightning's accelerator setting.

    Raises:
        DeuxError: the model does not exist.
    """
    guide = make_guide(model_name, accelerator)
    explorers, left_out = _explorers(guide)
    executors, missing = _executors()
    runs = {
        (name, where): partial(_Exploration(settings, name, guide).run, execute)
        for name in explorers
        for where, execute in executors.items()
    }
    for name in explorers:  # warm-up: compiles the kernels
        _Exploration(ProcessSettings(settings.size, 1, steps=4), name, guide).run(executors[_ONE])
    found = in_turn(runs, settings.rounds)
    rows: list[dict[str, Value]] = []
    for name in explorers:
        ratios = times({where: [run.whole for run in found[name, where]] for where in executors}, _ONE)
        rows += [
            {
                "explorer": name,
                "depth model": guide.name if guide is not None and explorers[name] else "none",
                "where": where,
                "steps per second, whole": Spread.of([run.whole for run in found[name, where]]),
                "times one process": ratios[where],
                "steps per second, steady": Spread.of([run.steady for run in found[name, where]]),
            }
            for where in executors
        ]
    title = f"Processes: {settings.robots} robots of {settings.steps} steps each at {settings.size} x {settings.size}"
    notes = (
        "Whole: from the call to the last file, including the start of the processes (and of Ray) and the loading of "
        "model and scenes. Steady: after the first third of the steps. All rows of an explorer have the same frames.",
        *left_out,
        *missing,
    )
    yield SpeedTable("processes", title, tuple(rows), notes)


def _explorers(guide: Guide | None) -> tuple[dict[str, bool], tuple[str, ...]]:
    """Explorers to measure, mapped to whether they need a depth model, and notes on the excluded ones."""
    made, notes = installed("explorers")
    unseen = {Need.LABELS, Need.FREE_SPACE}
    guided = [name for name, explorer in made.items() if explorer.needs & MODEL_NEEDS]
    others = [name for name, explorer in made.items() if not explorer.needs & (MODEL_NEEDS | unseen)]
    if guide is None:
        notes += tuple(f"{name} is left out: no depth model is installed." for name in guided[:1])
        guided = []
    return {**dict.fromkeys(guided[:1], True), **dict.fromkeys(others[:1], False)}, notes


def _executors() -> tuple[dict[str, Executor], tuple[str, ...]]:
    """Executors by their names in the table, and a note if Ray is missing."""
    found: dict[str, Executor] = {
        _ONE: make_executor("local", {}),
        f"{PROCESSES} processes": make_executor("local", {}, PROCESSES),
    }
    try:
        found[f"Ray, {PROCESSES} workers"] = make_executor("ray", {"workers": PROCESSES})
    except DeuxError as error:
        return found, (f"Ray is left out: {error}",)
    return found, ()


class _Run(NamedTuple):
    """Steps per second of an exploration: of the whole, and after the first third of the steps."""

    whole: float
    steady: float


class _Exploration:
    """Repeated explorations by one explorer. The n-th run of all instances with equal arguments has the same seeds.

    Args:
        settings: the settings of the benchmark.
        name: name of the explorer.
        guide: depth model and uncertainty; None if there is no model.
    """

    def __init__(self, settings: ProcessSettings, name: str, guide: Guide | None) -> None:
        self._settings, self._guide = settings, guide
        self._choice = registry().choose("explorers", {"name": name})
        self._round = -1

    def run(self, execute: Executor) -> _Run:
        """Collect one episode in each flat into temporary files."""
        self._round += 1
        settings, guide = self._settings, self._guide
        told: list[tuple[int, float]] = []
        with tempfile.TemporaryDirectory() as folder:
            plans = [
                EpisodePlan(Path(folder) / scene.name, scene, self._round, settings.steps)
                for scene in flats(settings.robots)
            ]
            began = time.perf_counter()
            explore(
                plans,
                default_simulation(settings.size).make,
                self._choice.create,
                guide and guide.predict_depth,
                uncertainty=guide and guide.uncertainty,
                batch_size=settings.robots,
                execute=execute,
                progress=lambda stage, done, total: told.append((done, time.perf_counter())),
            )
            ended = time.perf_counter()
            steps = sum(len(json.loads(plan.record.read_bytes())["actions"]) for plan in plans)
        return _Run(steps / (ended - began), _steady_rate(told, steps))


def _steady_rate(told: list[tuple[int, float]], steps: int) -> float:
    """Steps per second after the first third of the steps; NaN if that took no time.

    Args:
        told: the reports of progress, pairs of (steps so far, time in seconds). They include the steps that an explorer
            omits when it stops early, which are not counted.
        steps: number of steps that were taken.
    """
    reports = [(min(done, steps), when) for done, when in told]
    first = next(report for report in reports if report[0] >= _WARM_UP * steps)
    last = next(report for report in reports if report[0] == steps)
    return (last[0] - first[0]) / (last[1] - first[1]) if last[1] > first[1] else float("nan")
