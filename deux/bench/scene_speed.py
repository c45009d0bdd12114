"""Benchmark of generated scenes: time to create and prepare them, and their size."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from deux.bench.bench_scenes import default_simulation, free_poses
from deux.bench.installed_plugins import installed
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.timing import Spread, Stopwatch
from deux.contracts import COLOR, Scene, SceneMesh, SceneReference, Simulator
from deux.errors import DeuxError
from deux.simulator.simulation import Simulation


@dataclass(frozen=True)
class SceneSettings:
    """Settings of the benchmark of generated scenes.

    Args:
        size: width and height of the images in pixels.
        scenes: number of scenes of each scene source.
    """

    size: int = 64
    scenes: int = 40


QUICK = SceneSettings(scenes=4)
"""Settings for a quick test."""


def measure_scenes(settings: SceneSettings) -> Iterator[SpeedTable]:
    """Measure generation, computation of the free space, rendering of the first image and size of scenes."""
    sources, broken = installed("scenes")
    simulation = default_simulation(settings.size)
    rows: list[dict[str, Value]] = []
    notes = list(broken)
    for name, source in sources.items():
        try:
            scenes = source.further(settings.scenes, ())
        except DeuxError as error:
            notes.append(f"{name} is left out: {error}")
            continue
        _prepare(scenes[0].load(), simulation, Stopwatch())  # warm-up: compiles the kernels
        rows.append({"source": name, **_measured(scenes, simulation)})
    title = f"Scenes: {settings.scenes} of each source, first image of {settings.size} x {settings.size}"
    yield SpeedTable("scenes", title, tuple(rows), tuple(notes))


def _measured(scenes: tuple[SceneReference, ...], simulation: Simulation) -> dict[str, Spread]:
    """Measure sizes and times of all scenes, by column of the table."""
    sizes: dict[str, list[float]] = defaultdict(list)
    watch = Stopwatch()
    for reference in scenes:
        with watch.measure("make"):
            scene = reference.load()
        simulator = _prepare(scene, simulation, watch)
        area = scene.floors[0].area
        sizes["square metres"].append(area)
        sizes["free square metres"].append(simulator.free_space().area)
        sizes["triangles"].append(len(scene.mesh.faces))
        sizes["textures"].append(len(_textures(scene.mesh)))
        sizes["MB"].append(_megabytes(scene.mesh))
        for part in ("make", "free floor", "first image"):
            sizes[f"{part} (s)"].append(watch.durations[part][-1])
        total = sum(watch.durations[part][-1] for part in watch.durations)
        sizes["all (ms per square metre)"].append(1e3 * total / area)
    return {column: Spread.of(values) for column, values in sizes.items()}


def _prepare(scene: Scene, simulation: Simulation, watch: Stopwatch) -> Simulator:
    """Create a simulator of a scene, compute its free space and render an image, measuring the last two."""
    simulator = simulation.make(_Loaded(scene.name, scene))
    with watch.measure("free floor"):
        simulator.free_space()
    poses = free_poses(simulator, 1, seed=0)
    with watch.measure("first image"):
        simulator.observe(COLOR, poses)
    return simulator


@dataclass(frozen=True)
class _Loaded(SceneReference):
    """Reference of a scene that is already in memory."""

    scene: Scene

    @property
    def identity(self) -> str:
        return self.scene.identity

    def load(self) -> Scene:
        return self.scene


def _textures(mesh: SceneMesh) -> dict[int, int]:
    """Size of each texture in bytes, by its id, since materials share textures."""
    return {id(m.texture): m.texture.nbytes for m in mesh.materials if m.texture is not None}


def _megabytes(mesh: SceneMesh) -> float:
    """Memory of a mesh and its textures in MB."""
    arrays = (mesh.vertices, mesh.faces, mesh.uv, mesh.face_material, mesh.face_label, mesh.vertex_colors)
    return (sum(array.nbytes for array in arrays if array is not None) + sum(_textures(mesh).values())) / 1e6
