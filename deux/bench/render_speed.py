"""Benchmark of renderers: frames per second."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deux.bench.bench_scenes import FinerScene, flats, free_poses, scene_in, usable_simulators
from deux.bench.concurrent_processes import at_once
from deux.bench.machine import cores
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.timing import Spread, in_turn, rate, times_the_slowest
from deux.contracts import COLOR, SceneReference, Simulator
from deux.geometry.camera import Camera


@dataclass(frozen=True)
class RenderSettings:
    """Settings of the benchmark of renderers.

    Args:
        sizes: sizes of the square images in pixels.
        processes: numbers of processes that render at once.
        triangles: number of triangles of the larger scene.
        rounds: number of measurements of each renderer.
        seconds: duration of each measurement.
        poses: number of different poses to cycle through.
    """

    sizes: tuple[int, ...] = (400, 128)
    processes: tuple[int, ...] = (1, 2)
    triangles: int = 150_000
    rounds: int = 10
    seconds: float = 0.4
    poses: int = 64


QUICK = RenderSettings(sizes=(128,), rounds=3, seconds=0.1, poses=16)
"""Settings for a quick test."""


def measure_rendering(settings: RenderSettings, scene_file: Path | None) -> Iterator[SpeedTable]:
    """Measure every renderer on a generated flat and on a larger scene.

    Args:
        settings: the settings of the benchmark.
        scene_file: the larger scene; None for the flat with subdivided faces.

    Raises:
        DeuxError: the file is not a scene.
    """
    (flat,) = flats(1)
    larger = FinerScene(flat.name, flat, settings.triangles) if scene_file is None else scene_in(scene_file)
    rows: list[dict[str, Value]] = []
    left_out: dict[str, str] = {}
    for scene in (flat, larger):
        triangles = len(scene.load().mesh.faces)
        for processes in settings.processes:
            parts = at_once(_render, _Job(scene, settings), processes, _opengl_threads(processes))
            left_out |= parts[0].left_out
            for size in settings.sizes:
                rates = _summed([part.rates[size] for part in parts])
                ratios = times_the_slowest(rates)
                for name, values in rates.items():
                    rows.append(
                        {
                            "scene": scene.name,
                            "triangles": triangles,
                            "pixels": f"{size} x {size}",
                            "processes": processes,
                            "renderer": name,
                            "frames per second": Spread.of(values),
                            "times the slowest": ratios[name],
                        }
                    )
    notes = [f"{name} is left out: {reason}" for name, reason in left_out.items()]
    threads = (
        "Frames are of random free poses, a new one each. embree renders on 1 thread in each process; OpenGL without "
        f"a card draws on as many as there are cores, {cores()}; several processes draw on one thread each."
    )
    yield SpeedTable("render", "Rendering: colour and depth as numpy arrays", tuple(rows), (threads, *notes))


def _opengl_threads(processes: int) -> int:
    """Number of Mesa's rendering threads beside the calling thread; none if several processes share the cores."""
    return cores() if processes == 1 else 0


class _Job(NamedTuple):
    scene: SceneReference
    settings: RenderSettings


class _Rates(NamedTuple):
    """Result of one process: frames per second in each round, by image size and renderer, and excluded renderers."""

    rates: dict[int, dict[str, list[float]]]
    left_out: dict[str, str]


def _render(job: _Job, together: Callable[[], None]) -> _Rates:
    """Measure all renderers in this process, synchronized with the other processes."""
    settings = job.settings
    simulators, left_out = usable_simulators(job.scene, Camera(settings.sizes[0], settings.sizes[0]))
    poses = {name: cycle(free_poses(simulator, settings.poses, seed=0)) for name, simulator in simulators.items()}

    def frames_per_second(simulator: Simulator, poses: Iterator[np.ndarray]) -> float:
        together()
        return rate(lambda: simulator.observe(COLOR, next(poses)[None]), settings.seconds)

    rates = {}
    for size in settings.sizes:
        sized = {name: simulator.another(Camera(size, size)) for name, simulator in simulators.items()}
        for name, simulator in sized.items():  # warm-up: compiles the kernels and uploads the scene
            simulator.observe(COLOR, next(poses[name])[None])
        calls = {name: partial(frames_per_second, simulator, poses[name]) for name, simulator in sized.items()}
        rates[size] = in_turn(calls, settings.rounds)
    return _Rates(rates, left_out)


def _summed(parts: list[dict[str, list[float]]]) -> dict[str, list[float]]:
    """Total frames per second of all processes in each round, by renderer."""
    return {name: [sum(rates) for rates in zip(*(part[name] for part in parts), strict=True)] for name in parts[0]}
