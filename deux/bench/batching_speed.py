"""Benchmark of batching: rendering of several frames at once, and walks in lock-step."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle

import numpy as np

from deux.bench.bench_scenes import default_simulation, flats, free_poses, usable_simulators
from deux.bench.installed_plugins import Guide, make_guide
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.timing import Spread, Stopwatch, in_turn, rate, times
from deux.collection.perception import SOURCES, Perception
from deux.collection.walk import Walk, run_walks
from deux.contracts import COLOR, DEPTH, Action, Channels, Episode, Explorer, Observation, Simulator
from deux.geometry.camera import Camera


@dataclass(frozen=True)
class BatchingSettings:
    """Settings of the benchmark of batching.

    Args:
        sizes: sizes of the square images of the rendering benchmark, in pixels.
        poses: numbers of poses per call of `Simulator.observe`; the first must be 1.
        places: number of different poses to cycle through.
        seconds: duration of each measurement of rendering.
        walk_size: width and height of a robot's images in pixels.
        walks: numbers of walks that run in lock-step; the first must be 1, and the last is the total number of walks.
        steps: number of measured steps of each walk. The first `SOURCES` steps, which have no residual, are excluded.
        rounds: number of measurements of each variant.
    """

    sizes: tuple[int, ...] = (64, 128)
    poses: tuple[int, ...] = (1, 16)
    places: int = 64
    seconds: float = 0.4
    walk_size: int = 128
    walks: tuple[int, ...] = (1, 4)
    steps: int = 15
    rounds: int = 5


QUICK = BatchingSettings(sizes=(64,), places=16, seconds=0.1, steps=4, rounds=3)
"""Settings for a quick test."""


def measure_batching(
    settings: BatchingSettings, model_name: str | None, accelerator: str = "auto"
) -> Iterator[SpeedTable]:
    """Measure one call of `Simulator.observe` with many poses, and one call of the depth model for many robots.

    Args:
        settings: the settings of the benchmark.
        model_name: name of the depth model; None for the default of `make_guide`.
        accelerator: Lightning's accelerator setting.

    Raises:
        DeuxError: the model does not exist.
    """
    guide = make_guide(model_name, accelerator)
    yield _frames_table(settings)
    yield _walks_table(settings, guide)


def _frames_table(settings: BatchingSettings) -> SpeedTable:
    """Measure the frame rate of `Simulator.observe` for each number of poses per call."""
    simulators, left_out = usable_simulators(flats(1)[0], Camera(settings.sizes[0], settings.sizes[0]))
    rows: list[dict[str, Value]] = []
    for size in settings.sizes:
        for renderer, simulator in simulators.items():
            sized = simulator.another(Camera(size, size))
            for seen, channels in {"depth and colour": COLOR, "depth": DEPTH}.items():
                rates = _frame_rates(sized, channels, settings)
                ratios = times(rates, settings.poses[0])
                rows += [
                    {
                        "pixels": f"{size} x {size}",
                        "renderer": renderer,
                        "frames": seen,
                        "poses in a call": count,
                        "frames per second": Spread.of(rates[count]),
                        "times one by one": ratios[count],
                    }
                    for count in rates
                ]
    notes = tuple(f"{name} is left out: {reason}" for name, reason in left_out.items())
    return SpeedTable("batching", "Batches of frames: observe() with one pose and with many", tuple(rows), notes)


def _frame_rates(simulator: Simulator, channels: Channels, settings: BatchingSettings) -> dict[int, list[float]]:
    """Frames per second in each round, by the number of poses per call."""
    poses = cycle(free_poses(simulator, settings.places, seed=0))

    def observe(count: int) -> None:
        simulator.observe(channels, np.stack([next(poses) for _ in range(count)]))

    for count in settings.poses:  # warm-up: compiles the kernels and uploads the scene
        observe(count)
    calls = {count: partial(rate, partial(observe, count), settings.seconds) for count in settings.poses}
    return {
        count: [count * calls_per_second for calls_per_second in found]
        for count, found in in_turn(calls, settings.rounds).items()
    }


def _walks_table(settings: BatchingSettings, guide: Guide | None) -> SpeedTable:
    """Measure the step rate of walks with a depth model for each number of walks in lock-step."""
    size, robots = settings.walk_size, settings.walks[-1]
    title = f"Walks in lock-step: steps with a depth model at {size} x {size}"
    if guide is None:
        return SpeedTable("batching_walks", title, (), ("no depth model is installed.",))
    perception = Perception(guide.predict_depth, uncertainty=guide.uncertainty)
    simulators = [default_simulation(size).make(scene) for scene in flats(robots)]
    calls = {count: partial(_steps_per_second, simulators, perception, count, settings) for count in settings.walks}
    for call in calls.values():  # warm-up: allocates memory and selects algorithms
        call()
    rates = in_turn(calls, settings.rounds)
    ratios = times(rates, settings.walks[0])
    rows: tuple[dict[str, Value], ...] = tuple(
        {
            "depth model": guide.name,
            "walks in lock-step": count,
            "steps per second": Spread.of(rates[count]),
            "times one by one": ratios[count],
        }
        for count in rates
    )
    note = (
        f"All rows take the same {robots} walks in {robots} flats, in groups of that many. A step draws a frame, "
        "samples points, predicts its depth, computes the residual and moves; no files are written."
    )
    return SpeedTable("batching_walks", title, rows, (note,))


def _steps_per_second(
    simulators: Sequence[Simulator], perception: Perception, count: int, settings: BatchingSettings
) -> float:
    """Steps per second of one walk in each simulator, with `count` walks at a time in lock-step."""
    watch, steps = Stopwatch(), 0
    for first in range(0, len(simulators), count):
        group = simulators[first : first + count]
        walks = run_walks([Walk(robot, _Wanderer(), 0, SOURCES + settings.steps) for robot in group], perception)
        for _ in range(SOURCES):
            next(walks)
        with watch.measure("walks"):
            steps += sum(len(step) for step in walks)
    return steps / watch.total("walks")


class _Wanderer(Explorer):
    """An explorer that goes straight and turns left after collisions; its own run time is negligible."""

    def reset(self, episode: Episode) -> None:
        """Do nothing: there is no state to reset."""

    def act(self, observation: Observation) -> Action:
        """Return FORWARD, or LEFT after a collision."""
        return Action.LEFT if observation.collided else Action.FORWARD
