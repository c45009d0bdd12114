"""Steps a second of the explorers, in the collector's own loop."""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from torch import Tensor

from deux.bench.installed import installed
from deux.bench.report import Table, Value
from deux.bench.scenes import flat
from deux.bench.timing import Spread, Stopwatch, in_turn, times_the_slowest
from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import MODEL_NEEDS, explore
from deux.contracts import (
    Action,
    DepthModel,
    DepthPredictor,
    Episode,
    Explorer,
    ExplorerMap,
    Frame,
    Observation,
    Robot,
    Scene,
)
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.registry import registry
from deux.simulator.mesh_simulator import MeshSimulator


@dataclass(frozen=True)
class ExploreSettings:
    """What is explored, and for how long.

    Args:
        size: width and height of the images in pixels.
        robots: number of flats that are explored together, with one robot in each.
        steps: steps of each robot in each round.
        warm_up: first steps of each round that are not counted.
        rounds: number of times that each explorer is measured.
    """

    size: int = 128
    robots: int = 4
    steps: int = 70
    warm_up: int = 10
    rounds: int = 5


QUICK = ExploreSettings(steps=10, warm_up=3, rounds=2)
"""Settings for a quick look."""


def default_model() -> str | None:
    """Name of the first installed depth model that trains without ground truth; None if there is none."""
    models, _ = installed("depth_models")
    return next((name for name, model in models.items() if not model.supervised), None)


def measure_exploration(settings: ExploreSettings, model_name: str | None) -> Iterator[Table]:
    """Measure every installed explorer, with its default options.

    Args:
        settings: what is explored.
        model_name: the depth model for explorers that need one, untrained; `default_model` if None.

    Raises:
        DeuxError: there is no such model.
    """
    model_name = model_name or default_model()
    model: DepthModel | None = None
    if model_name is not None:
        model = registry().create("depth_models", model_name, {}).eval()
    explorers, broken = installed("explorers")
    notes = [
        f"{settings.robots} robots in {settings.robots} flats take turns in one process. The explorer's share is all "
        "that its act() does; what is left over is bookkeeping, sparse points and waiting for files to be written.",
        *broken,
    ]
    guided = {name: bool(explorer.needs & MODEL_NEEDS) for name, explorer in explorers.items()}
    if model is None:
        notes += [f"{name} is left out: no depth model is installed." for name in guided if guided[name]]
        guided = {name: False for name in guided if not guided[name]}
    world = _World(settings)
    predict = None if model is None else model.predict
    runs = {name: partial(world.run, name, predict, steps=settings.steps) for name in guided}
    for run in runs.values():  # compiles the kernels, builds the free floors
        run(steps=settings.warm_up + 1)
    found = in_turn(runs, settings.rounds)
    ratios = times_the_slowest({name: [run.steps_per_second for run in runs] for name, runs in found.items()})
    rows = tuple(
        {
            "explorer": name,
            "depth model": model_name if guided[name] and model_name else "none",
            "steps per second": Spread.of([run.steps_per_second for run in found[name]]),
            "times the slowest": ratios[name],
            "act(), ms": Spread.of([1e3 * duration for run in found[name] for duration in run.acts]),
            **_shares(found[name]),
        }
        for name in found
    )
    title = f"Exploration: whole steps of the collector at {settings.size} x {settings.size}, and where their time goes"
    yield Table("explore", title, rows, tuple(notes))


class _Run(NamedTuple):
    """One round of one explorer: its rate, the seconds of each act(), and the share of each part in %."""

    steps_per_second: float
    acts: list[float]
    shares: dict[str, float]


PARTS = ("render", "depth model", "explorer")


def _shares(runs: list[_Run]) -> dict[str, Value]:
    return {f"{part}, %": Spread.of([run.shares[part] for run in runs]) for part in (*PARTS, "rest")}


class _World:
    """The flats, which are loaded once, and the episodes in them."""

    def __init__(self, settings: ExploreSettings) -> None:
        self._settings = settings
        self._watch = Stopwatch()
        self._rounds: dict[str, int] = {}
        self._scenes = [flat(seed) for seed in range(settings.robots)]
        camera = Camera(settings.size, settings.size)
        self._simulators = {
            scene: _TimedSimulator(scene.load(), camera, Robot(), self._watch) for scene in self._scenes
        }

    def run(self, name: str, predict: DepthPredictor | None, steps: int) -> _Run:
        """Collect one episode in each flat, with a seed of its own in each round, into files that are then deleted."""
        number = self._rounds[name] = self._rounds.get(name, -1) + 1
        watch = self._watch
        clock = _Clock(watch, warm_up=self._settings.warm_up)
        with tempfile.TemporaryDirectory() as folder:
            explore(
                [EpisodePlan(Path(folder) / scene.name, scene, number, steps) for scene in self._scenes],
                self._simulators.__getitem__,
                lambda: _TimedExplorer(registry().create("explorers", name, {}), watch),
                predict and _timed(predict, watch),
                batch_size=len(self._scenes),
                progress=clock,
            )
        return clock.result()


class _Clock:
    """Counts the steps that the collector reports, but for the first ones of each robot."""

    def __init__(self, watch: Stopwatch, warm_up: int) -> None:
        self._watch, self._warm_up = watch, warm_up
        self._reports = 0
        self._began = self._ended = (0.0, 0)

    def __call__(self, stage: str, done: int, total: int) -> None:
        now = (time.perf_counter(), done)
        self._reports += 1
        if self._reports == self._warm_up:
            self._watch.durations.clear()
            self._began = now
        if done > self._ended[1]:  # what comes after the last step, such as writing maps, reports no more steps
            self._ended = now

    def result(self) -> _Run:
        """What was measured."""
        seconds, steps = (end - begin for begin, end in zip(self._began, self._ended, strict=True))
        if steps <= 0:
            raise DeuxError("no step is left to measure: an explorer stopped during the warm-up.")
        shares = {part: 100.0 * self._watch.total(part) / seconds for part in PARTS}
        shares["rest"] = 100.0 - sum(shares.values())
        return _Run(steps / seconds, self._watch.durations["explorer"].copy(), shares)


class _TimedSimulator(MeshSimulator):
    def __init__(self, scene: Scene, camera: Camera, robot: Robot, watch: Stopwatch) -> None:
        super().__init__(scene, camera, robot)
        self._watch = watch

    def observe(self, labels: bool = False) -> Frame:
        with self._watch.measure("render"):
            return super().observe(labels)


class _TimedExplorer(Explorer):
    def __init__(self, explorer: Explorer, watch: Stopwatch) -> None:
        self._explorer, self._watch = explorer, watch
        self.needs = explorer.needs

    def reset(self, episode: Episode) -> None:
        self._explorer.reset(episode)

    def act(self, observation: Observation) -> Action:
        with self._watch.measure("explorer"):
            return self._explorer.act(observation)

    def map(self) -> ExplorerMap | None:
        return self._explorer.map()


def _timed(predict: DepthPredictor, watch: Stopwatch) -> DepthPredictor:
    def timed(*inputs: Tensor) -> Tensor:
        with watch.measure("depth model"):
            return predict(*inputs)

    return timed
