"""Benchmark against other software that does the same work.

Libraries on which deux depends are measured on this machine, in alternation with deux. All other figures are recorded:
single measurements on two Xeon cores without a GPU, unless their name says otherwise.
"""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, cycle
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from kornia.feature import harris_response
from scipy.interpolate import LinearNDInterpolator
from skimage.feature import corner_harris, corner_peaks
from skimage.graph import MCP_Geometric

from deux.bench.bench_scenes import default_simulation, flats, free_poses, scene_in
from deux.bench.model_speed import StepVariant, train_steps
from deux.bench.rendered_batch import render_batch
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.step_clock import StepClock
from deux.bench.timing import Spread, Stopwatch, in_turn, rate
from deux.collection.sparse import SparseSettings, point_count, sample_sparse
from deux.contracts import COLOR, Frame, SceneReference
from deux.environment.exploration_env import ExplorationEnv
from deux.environment.scene_pool import ScenePool
from deux.geometry.camera import Camera
from deux.geometry.scaffolding import interpolate
from deux.inference.precision import FastPredictor, default_precision
from deux.io.frames import prepare_folders, read_frame, write_frame
from deux.io.layout import SequencePaths
from deux.mapping.planning import distance_field, shortest_path
from deux.policies.ppo import train_policy
from deux.policies.ppo_settings import PPOSettings
from deux.registry import registry
from deux.scenes.free_space import free_space


@dataclass(frozen=True)
class PeerSettings:
    """Settings of the benchmark against other software.

    Args:
        rounds: number of measurements of each call.
        seconds: duration of each measurement.
    """

    rounds: int = 5
    seconds: float = 0.3


QUICK = PeerSettings(rounds=2, seconds=0.05)
"""Settings for a quick test."""


class Peer(NamedTuple):
    """Other software that does the same work.

    Args:
        name: name of the software, and of the data or machine of a recorded figure where these differ.
        figure: recorded milliseconds; None if `call` is measured.
        call: function that does the work once; None for a recorded figure.
    """

    name: str
    figure: float | None = None
    call: Callable[[], object] | None = None


class Work(NamedTuple):
    """Work that deux and other software do.

    Args:
        name: name of the work.
        call: function that does the work once with deux; if `timed`, it returns the milliseconds per unit of work.
        peers: the other software.
        timed: whether `call` measures the time itself.
    """

    name: str
    call: Callable[[], Any]
    peers: Sequence[Peer]
    timed: bool = False


def measure_peers(settings: PeerSettings, scene_file: Path | None, accelerator: str = "auto") -> Iterator[SpeedTable]:
    """Measure the time that deux needs for work with known figures of other software.

    Args:
        settings: the settings of the benchmark.
        scene_file: scene to render; None for a generated flat.
        accelerator: Lightning's accelerator setting.
    """
    scene = flats(1)[0] if scene_file is None else scene_in(scene_file)
    rows: list[dict[str, Value]] = []
    with tempfile.TemporaryDirectory() as folder:
        parts = (
            _drawing(scene),
            _planning(),
            _points(scene),
            _files(scene, Path(folder)),
            _learning(),
            _models(accelerator),
        )
        for work in chain(*parts):
            rows += _rows(work, settings)
    note = (
        "Recorded figures were measured on two Xeon cores without a GPU unless stated otherwise, those of frames in "
        "a furnished room of 21,700 triangles; rows marked 'here' are measured alternately with deux."
    )
    yield SpeedTable("peers", f"Other software: milliseconds; frames of {scene.name}", tuple(rows), (note,))


def _rows(work: Work, settings: PeerSettings) -> list[dict[str, Value]]:
    others = {peer.name: peer.call for peer in work.peers if peer.call is not None}
    for call in (work.call, *others.values()):  # warm-up: compiles the kernels
        call()
    timed: dict[str, Callable[[], float]] = {
        name: partial(_milliseconds, call, settings.seconds) for name, call in others.items()
    }
    timed["deux"] = work.call if work.timed else partial(_milliseconds, work.call, settings.seconds)
    found = {name: Spread.of(values) for name, values in in_turn(timed, settings.rounds).items()}
    rows: list[dict[str, Value]] = []
    for peer in work.peers:
        theirs = found[peer.name].median if peer.figure is None else peer.figure
        rows.append(
            {
                "work": work.name,
                "peer": peer.name,
                "peer, ms": f"{theirs:.3g}{', here' if peer.figure is None else ''}",
                "deux here, ms": found["deux"],
                "times the peer's speed": f"{theirs / found['deux'].median:.2f}",
            }
        )
    return rows


def _milliseconds(call: Callable[[], object], seconds: float) -> float:
    return 1e3 / rate(call, seconds)


def _drawing(scene: SceneReference) -> Iterator[Work]:
    """Rendering of colour and depth to numpy arrays in one process, and computation of the free space."""
    recorded = {
        400: {
            "Habitat-Sim, small_house.glb": 81.0,
            "moderngl": 155.0,
            "pyrender without multisampling": 112.0,
            "pyrender as it comes": 57.0,
            "pyrender by OSMesa": 44.0,
            "embreex and numba": 30.5,
            "trimesh.ray and numpy": 8.5,
            "Open3D and numba": 27.9,
            "VTK": 55.0,
            "mitsuba": 10.4,
        },
        128: {
            "Habitat-Sim, small_house.glb": 128.0,
            "moderngl": 550.0,
            "pyrender without multisampling": 220.0,
            "pyrender as it comes": 131.0,
            "pyrender by OSMesa": 62.0,
            "embreex and numba": 298.0,
            "trimesh.ray and numpy": 99.0,
            "Open3D and numba": 353.0,
            "VTK": 168.0,
            "mitsuba": 13.6,
        },
    }
    simulator = default_simulation(400).make(scene)
    poses = cycle(free_poses(simulator, 64, seed=0))
    for size, rates in recorded.items():
        sized = simulator.another(Camera(size, size))
        peers = [Peer(name, 1e3 / frames) for name, frames in rates.items()]
        yield Work(f"frame of {size} x {size}", lambda sized=sized: sized.observe(COLOR, next(poses)[None]), peers)  # type: ignore[misc]
    mesh, floor = scene.load().mesh, simulator.floors[0].height
    down = [
        Peer("embreex, rays straight down", 2.6),
        Peer("trimesh, one section", 9.0),
        Peer("trimesh, 14 sections", 81.0),
    ]
    yield Work("free floor on 5 cm cells", lambda: free_space(mesh, floor, simulator.robot), down)


def _planning() -> Iterator[Work]:
    """Paths and distances on a grid of 400 x 400 cells, 84 % of them free, from corner to corner."""
    rng = np.random.default_rng(0)
    blurred = cv2.GaussianBlur(rng.random((400, 400)), (0, 0), 4.0)
    free = blurred < np.quantile(blurred, 0.84)
    free[:20, :20] = free[-20:, -20:] = True
    costs = np.where(free, 1.0, -1.0)
    ends = (0, 0), (399, 399)

    def by_scikit_image() -> object:
        grid = MCP_Geometric(costs)
        grid.find_costs([ends[0]], [ends[1]])
        return grid.traceback(ends[1])

    path = [
        Peer("scikit-image, MCP_Geometric", call=by_scikit_image),
        Peer("pyastar2d, 5.8 % longer", 3.0),
        Peer("A* in numba", 8.8),
        Peer("scipy, csgraph.dijkstra", 50.7),
    ]
    yield Work("path over 400 x 400 cells", lambda: shortest_path(free, *ends), path)
    everywhere = [
        Peer("scikit-image, MCP_Geometric", call=lambda: MCP_Geometric(costs).find_costs([ends[0]])),
        Peer("Dijkstra in numba", 19.5),
    ]
    yield Work("distances to 400 x 400 cells", lambda: distance_field(free, ends[0]), everywhere)


def _points(scene: SceneReference) -> Iterator[Work]:
    """Sampling of sparse points of a frame, and their interpolation."""
    frame = _frame(scene, 400)
    settings = SparseSettings()
    gray = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY)
    image = torch.from_numpy(gray).float()[None, None] / 255.0
    count = point_count(gray.shape, settings)
    corners = [
        Peer("kornia, response alone", call=lambda: harris_response(image)),
        Peer("scikit-image", call=lambda: corner_peaks(corner_harris(gray), num_peaks=count)),
        Peer("OpenCV, response, maxima, best 1,500", 2.4),
        Peer("kornia, response, maxima, best 1,500", 5.0),
    ]
    yield Work("Harris points of 400 x 400", lambda: sample_sparse(frame.rgb, frame.depth, settings), corners)
    for size, figure in ((192, 5.2), (384, 20.0)):
        seen = _frame(scene, size)
        sparse = sample_sparse(seen.rgb, seen.depth, settings)
        peers = [
            Peer("scipy, LinearNDInterpolator", call=partial(_by_scipy, sparse)),
            Peer("VOICED's own, by scipy", figure),
        ]
        yield Work(f"interpolation of {size} x {size}", partial(interpolate, sparse), peers)


def _by_scipy(sparse: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(sparse)
    found: np.ndarray = LinearNDInterpolator(np.stack([rows, columns], 1), sparse[rows, columns])(
        *np.indices(sparse.shape)
    )
    return found


def _files(scene: SceneReference, folder: Path) -> Iterator[Work]:
    """Writing and reading of image, depth and pose of a frame of 400 x 400 pixels."""
    frame = _frame(scene, 400)
    paths = SequencePaths(folder / "sequence")
    prepare_folders(paths, Camera(400, 400).intrinsics, labels=False)
    write = {
        "PNG by OpenCV, level 1": 63.0,
        "PNG by OpenCV, level 3": 47.0,
        "PNG by Pillow, level 1": 55.0,
        "JPEG 95 and 16-bit PNG": 192.0,
        "npz, uint16, compressed": 47.0,
        "zarr, blosc-zstd": 125.0,
    }
    read = {
        "PNG by OpenCV, level 1": 141.0,
        "PNG by OpenCV, level 3": 147.0,
        "PNG by Pillow, level 1": 124.0,
        "JPEG 95 and 16-bit PNG": 312.0,
        "npz, uint16, compressed": 219.0,
        "zarr, blosc-zstd": 354.0,
    }
    yield Work("writing a frame", lambda: write_frame(paths, 0, frame), [Peer(n, 1e3 / v) for n, v in write.items()])
    yield Work("reading a frame", lambda: read_frame(paths, 0, False), [Peer(n, 1e3 / v) for n, v in read.items()])


def _learning() -> Iterator[Work]:
    """Training of a policy by PPO, per step of the environment, including the updates."""
    settings = PPOSettings(steps=1024, environments=8, batch_size=256)
    rewards = registry().names("rewards")
    if not rewards:
        return
    pool, scenes = ScenePool(default_simulation(64)), flats(1)

    def make() -> ExplorationEnv:
        return ExplorationEnv(scenes, registry().create("rewards", rewards[0], {}), steps=settings.episode, pool=pool)

    def learn() -> float:
        watch = Stopwatch()
        with tempfile.TemporaryDirectory() as folder, watch.measure("learning"):
            train_policy(settings, make, 0, Path(folder))
        return 1e3 * watch.total("learning") / settings.steps

    peers = [
        Peer("stable-baselines3, NatureCNN, an environment that costs nothing", 1e3 / 1299),
        Peer("stable-baselines3, small CNN, an environment that costs nothing", 1e3 / 750),
        Peer("sb3-contrib, LSTM 128, an environment that costs nothing", 1e3 / 272),
    ]
    yield Work(f"PPO step, reward {rewards[0]}", learn, peers, timed=True)


def _models(accelerator: str) -> Iterator[Work]:
    """Training step and inference of KBNet, if it is installed."""
    if "kbnet" not in registry().names("depth_models"):
        return
    precision = "bfloat16" if default_precision(accelerator).startswith("bf16") else "float32"
    variant = StepVariant("kbnet", precision, "learned")
    batch = render_batch(registry().create("depth_models", "kbnet", {}), 192, 2)

    def train() -> float:
        train_steps(variant, batch, 2, clock := StepClock(), accelerator)
        return 1e3 * Spread.of(clock.steps).median

    step = [Peer("KBNet's own code", 1050.0)]
    yield Work(f"KBNet training step in {precision}, 2 x 192 x 192, learned poses", train, step, timed=True)
    predictor = FastPredictor(registry().create("depth_models", "kbnet", {}).eval(), accelerator)
    for (height, width), peers in {
        (384, 384): [Peer("KBNet's own code", 880.0)],
        (480, 640): [Peer("KBNet's own code, GTX 1080 Ti", 15.0)],
    }.items():
        image = torch.rand(1, 3, height, width, device=predictor.device)
        sparse = torch.where(torch.rand(1, 1, height, width, device=predictor.device) < 0.01, 2.0, 0.0)
        camera = torch.from_numpy(Camera(width, height).intrinsics).float()[None].to(predictor.device)
        name = f"KBNet in {precision}, {height} x {width}"
        yield Work(name, partial(_predict, predictor, image, sparse, camera), peers)


def _predict(predictor: FastPredictor, *inputs: torch.Tensor) -> float:
    return predictor(*inputs).sum().item()  # synchronizes with the device


def _frame(scene: SceneReference, size: int) -> Frame:
    """Render one frame at a random free pose."""
    simulator = default_simulation(size).make(scene)
    return simulator.observe(COLOR, free_poses(simulator, 1, seed=0))[0]
