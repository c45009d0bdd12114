"""Benchmark of explorers: steps per second of the collection of frames."""

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
from deux.bench.timing import Spread, Stopwatch, in_turn, times_the_slowest
from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.collection.perception import MODEL_NEEDS
from deux.contracts import Explorer, SceneReference, Simulator
from deux.errors import DeuxError, error_text
from deux.registry import registry
from deux.simulator.simulation import Simulation


@dataclass(frozen=True)
class ExploreSettings:
    """Settings of the benchmark of explorers.

    Args:
        size: width and height of the images in pixels.
        robots: number of flats that are explored together, with one robot in each.
        steps: number of steps of each robot in a round.
        warm_up: number of steps of each robot at the start of a round that are excluded.
        rounds: number of measurements of each explorer.
    """

    size: int = 128
    robots: int = 4
    steps: int = 70
    warm_up: int = 10
    rounds: int = 5


QUICK = ExploreSettings(steps=10, warm_up=3, rounds=2)
"""Settings for a quick test."""


def measure_exploration_speed(
    settings: ExploreSettings, model_name: str | None, accelerator: str = "auto"
) -> Iterator[SpeedTable]:
    """Measure every installed explorer with its default options.

    Args:
        settings: the settings of the benchmark.
        model_name: name of the depth model of explorers that need one; None for the default of `make_guide`.
        accelerator: Lightning's accelerator setting.

    Raises:
        DeuxError: the model does not exist.
    """
    guide = make_guide(model_name, accelerator)
    explorers, broken = installed("explorers")
    notes = [
        f"{settings.robots} robots in {settings.robots} flats take turns in one process. The explorer's share is the "
        "time in act(); the rest is bookkeeping, sparse points, the residual and waiting for files.",
        *broken,
    ]
    guided = {name: bool(explorer.needs & MODEL_NEEDS) for name, explorer in explorers.items()}
    if guide is None:
        notes += [f"{name} is left out: no depth model is installed." for name in guided if guided[name]]
        guided = {name: False for name in guided if not guided[name]}
    world = _World(settings, guide)
    runs = {name: partial(world.run, name, steps=settings.steps) for name in guided}
    for name, run in [*runs.items()]:  # warm-up: compiles the kernels and computes the free space
        try:
            run(steps=settings.warm_up + 1)
        except Exception as error:  # an explorer of another package may raise anything
            notes.append(f"{name} is left out: {error_text(error)}.")
            del runs[name]
    found = in_turn(runs, settings.rounds)
    ratios = times_the_slowest({name: [run.steps_per_second for run in runs] for name, runs in found.items()})
    rows = tuple(
        {
            "explorer": name,
            "depth model": guide.name if guide is not None and guided[name] else "none",
            "steps per second": Spread.of([run.steps_per_second for run in found[name]]),
            "times the slowest": ratios[name],
            "act(), ms": Spread.of([1e3 * duration for run in found[name] for duration in run.acts]),
            **_shares(found[name]),
        }
        for name in found
    )
    title = f"Exploration: whole steps of the collector at {settings.size} x {settings.size}, and where their time goes"
    yield SpeedTable("explore", title, rows, tuple(notes))


class _Run(NamedTuple):
    """Result of a round of one explorer: its step rate, seconds of each `act` and the share of each part in %."""

    steps_per_second: float
    acts: list[float]
    shares: dict[str, float]


PARTS = ("render", "depth model", "explorer")


def _shares(runs: list[_Run]) -> dict[str, Value]:
    return {f"{part}, %": Spread.of([run.shares[part] for run in runs]) for part in (*PARTS, "rest")}


class _World:
    """Simulators of the flats, which are loaded once, and the collection of episodes in them."""

    def __init__(self, settings: ExploreSettings, guide: Guide | None) -> None:
        self._settings = settings
        self._watch = Stopwatch()
        self._guide = guide
        self._predict = guide and self._watch.timed("depth model", guide.predict_depth)
        self._rounds: dict[str, int] = {}
        self._simulators = {
            scene: _timed_simulator(default_simulation(settings.size), scene, self._watch)
            for scene in flats(settings.robots)
        }

    def run(self, name: str, steps: int) -> _Run:
        """Collect one episode in each flat into temporary files; each round has a different seed."""
        number = self._rounds[name] = self._rounds.get(name, -1) + 1
        rate = _StepRate(self._watch, warm_up=self._settings.warm_up)
        with tempfile.TemporaryDirectory() as folder:
            explore(
                [EpisodePlan(Path(folder) / scene.name, scene, number, steps) for scene in self._simulators],
                self._simulators.__getitem__,
                lambda: _timed_explorer(name, self._watch),
                self._predict,
                uncertainty=self._guide and self._guide.uncertainty,
                batch_size=len(self._simulators),
                progress=rate,
            )
        return rate.result()


class _StepRate:
    """Progress callback that measures the step rate of all robots after the warm-up.

    Steps are counted by the calls of the explorers, since the progress that the collector reports includes the steps
    that an explorer omits when it stops early.
    """

    def __init__(self, watch: Stopwatch, warm_up: int) -> None:
        self._watch, self._warm_up = watch, warm_up
        self._reports = self._steps = 0
        self._began = self._ended = 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        now = time.perf_counter()
        self._reports += 1
        if self._reports == self._warm_up:
            self._watch.durations.clear()
            self._began = now
        steps = len(self._watch.durations["explorer"])
        if self._reports > self._warm_up and steps > self._steps:
            self._steps, self._ended = steps, now

    def result(self) -> _Run:
        """Return the measurements.

        Raises:
            DeuxError: no step followed the warm-up.
        """
        if self._steps == 0:
            raise DeuxError("no step is left to measure: an explorer stopped during the warm-up.")
        seconds = self._ended - self._began
        shares = {part: 100.0 * self._watch.total(part) / seconds for part in PARTS}
        shares["rest"] = 100.0 - sum(shares.values())
        return _Run(self._steps / seconds, self._watch.durations["explorer"].copy(), shares)


def _timed_simulator(simulation: Simulation, scene: SceneReference, watch: Stopwatch) -> Simulator:
    simulator = simulation.make(scene)
    simulator.render = watch.timed("render", simulator.render)  # type: ignore[method-assign]
    return simulator


def _timed_explorer(name: str, watch: Stopwatch) -> Explorer:
    explorer: Explorer = registry().create("explorers", name, {})
    explorer.act = watch.timed("explorer", explorer.act)  # type: ignore[method-assign]
    return explorer
