"""Frames a second of the renderers."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import NamedTuple

from deux.bench.machine import cores
from deux.bench.processes import at_once
from deux.bench.report import Table, Value
from deux.bench.scenes import BenchScene, flat, free_poses
from deux.bench.timing import Spread, in_turn, rate, times_the_slowest
from deux.contracts import Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.simulator.renderers import RENDERERS, make_renderer
from deux_plugins.scenes.files import FileReference, check_scene_file


@dataclass(frozen=True)
class RenderSettings:
    """What is rendered, and for how long.

    Args:
        sizes: widths, and heights, of the images in pixels.
        processes: numbers of processes that render at once.
        triangles: number of triangles of the larger scene.
        rounds: number of times that each renderer is measured.
        seconds: how long each time.
        poses: number of poses that the frames go through.
    """

    sizes: tuple[int, ...] = (400, 128)
    processes: tuple[int, ...] = (1, 2)
    triangles: int = 150_000
    rounds: int = 10
    seconds: float = 0.4
    poses: int = 64


QUICK = RenderSettings(sizes=(128,), rounds=3, seconds=0.1, poses=16)
"""Settings for a quick look."""


def measure_rendering(settings: RenderSettings, scene_file: Path | None) -> Iterator[Table]:
    """Measure every renderer on a generated flat and on a larger scene.

    Args:
        settings: what is rendered.
        scene_file: the larger scene; the flat with its faces split if None.

    Raises:
        DeuxError: the file is no scene.
    """
    larger = BenchScene(flat(0), settings.triangles)
    if scene_file is not None:
        path = check_scene_file(scene_file)
        larger = BenchScene(FileReference(path.stem, path))
    rows: list[dict[str, Value]] = []
    left_out: dict[str, str] = {}
    for scene in (BenchScene(flat(0)), larger):
        for processes in settings.processes:
            parts = at_once(_render, _Job(scene, settings), processes, cores())
            left_out |= parts[0].left_out
            for size in settings.sizes:
                rates = _summed([part.rates[size] for part in parts])
                ratios = times_the_slowest(rates)
                for name, values in rates.items():
                    rows.append(
                        {
                            "scene": scene.reference.name,
                            "triangles": parts[0].triangles,
                            "pixels": f"{size} x {size}",
                            "processes": processes,
                            "renderer": name,
                            "frames per second": Spread.of(values),
                            "times the slowest": ratios[name],
                        }
                    )
    notes = [f"{name} is left out: {reason}" for name, reason in left_out.items()]
    threads = (
        "Frames are of random free poses, a new one each. embree renders on 1 thread in each process; OpenGL without a "
        f"graphics card draws on as many as there are cores, {cores()}."
    )
    yield Table("render", "Rendering: colour and depth as numpy arrays", tuple(rows), (threads, *notes))


class _Job(NamedTuple):
    scene: BenchScene
    settings: RenderSettings


class _Rates(NamedTuple):
    """What one process measured: frames a second in each round, by image size and renderer."""

    triangles: int
    rates: dict[int, dict[str, list[float]]]
    left_out: dict[str, str]


def _render(job: _Job, together: Callable[[], None]) -> _Rates:
    """Measure in this process, at the same times as the others."""
    settings = job.settings
    scene = job.scene.load()
    poses = cycle(free_poses(scene, Robot(), settings.poses, seed=0))
    found = _Rates(len(scene.mesh.faces), {}, {})
    for size in settings.sizes:
        frames: dict[str, Callable[[], float]] = {}
        for name in RENDERERS:
            try:
                renderer = make_renderer(name, scene, Camera(size, size))
                renderer.render(next(poses), labels=False)  # compiles the kernels and uploads the scene
            except DeuxError as error:
                found.left_out[name] = str(error)
                continue

            def frames_per_second(render: Callable[..., object] = renderer.render) -> float:
                together()
                return rate(lambda: render(next(poses), labels=False), settings.seconds)

            frames[name] = frames_per_second
        found.rates[size] = in_turn(frames, settings.rounds)
    return found


def _summed(parts: list[dict[str, list[float]]]) -> dict[str, list[float]]:
    """Frames a second of all processes together in each round, by renderer."""
    return {name: [sum(rates) for rates in zip(*(part[name] for part in parts), strict=True)] for name in parts[0]}
