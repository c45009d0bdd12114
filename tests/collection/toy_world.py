"""A textured box room rendered by a few lines of numpy, robots that follow scripts, and a depth model that guesses."""

import hashlib
import math
import pickle
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from deux.collection.jobs import Job, JobRunner, P, share_out
from deux.collection.specification import DatasetSpec
from deux.contracts import (
    Action,
    Channel,
    Channels,
    DepthModel,
    Episode,
    Explorer,
    ExplorerMap,
    Floor,
    Frame,
    Need,
    Observation,
    Prediction,
    Robot,
    SceneReference,
    Simulator,
)
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace, GridFrame
from deux.geometry.poses import camera_pose
from deux.inference.precision import FastPredictor
from deux.io.processes import Count
from deux.registry import PluginChoice
from deux.simulator.simulation import Simulation

CAMERA = Camera(width=48, height=40, hfov=90.0)
ROOM = np.array([[-3.0, 0.0, -2.0], [3.0, 2.5, 2.0]])
MARGIN = 0.3
ROBOT = Robot()
SIMULATION = Simulation(CAMERA, ROBOT, PluginChoice("simulators", "toy", {}))
L1 = PluginChoice("uncertainties", "l1", {})


@dataclass(frozen=True)
class ToyScene(SceneReference):
    name: str = "room"
    kind: str = "toy-1"

    @property
    def identity(self) -> str:
        return self.kind


@dataclass
class ToySimulator(Simulator):
    """Two floors of one room each: walls, floor and ceiling; colour is a pattern of sines in world space."""

    scene: ToyScene = field(default_factory=ToyScene)
    camera: Camera = CAMERA
    robot: Robot = ROBOT
    delay: float = 0.0
    label_names: tuple[str, ...] = ("x", "y", "z")
    object_labels: tuple[str, ...] = ()
    floors: tuple[Floor, ...] = (Floor(0.0, 24.0), Floor(3.0, 24.0))
    rendered: int = 0
    batches: list[int] = field(default_factory=list)
    state: tuple[float, float, float] = (0.0, 0.0, 0.0)
    floor: int = 0

    def reset(self, x: float, z: float, yaw: float, floor: int = 0) -> None:
        self.state, self.floor = (x, z, yaw), floor

    def step(self, action: Action) -> bool:
        x, z, yaw = self.state
        turn = math.radians(self.robot.turn_angle)
        if action == Action.FORWARD:
            goal = x - self.robot.forward_step * math.sin(yaw), z - self.robot.forward_step * math.cos(yaw)
            x = float(np.clip(goal[0], ROOM[0, 0] + MARGIN, ROOM[1, 0] - MARGIN))
            z = float(np.clip(goal[1], ROOM[0, 2] + MARGIN, ROOM[1, 2] - MARGIN))
            self.state = (x, z, yaw)
            return (x, z) != goal
        self.state = (x, z, yaw + (turn if action == Action.LEFT else -turn))
        return False

    @property
    def pose(self) -> np.ndarray:
        x, z, yaw = self.state
        return camera_pose(x, self.floors[self.floor].height + self.robot.camera_height, z, yaw)

    def render(self, poses: np.ndarray, channels: Channels) -> list[Frame]:
        self.batches.append(len(poses))
        return [self._frame(pose, channels) for pose in poses]

    def another(self, camera: Camera | None = None) -> "ToySimulator":
        return ToySimulator(self.scene, camera or self.camera, self.robot)

    def _frame(self, pose: np.ndarray, channels: Channels) -> Frame:
        time.sleep(self.delay)
        self.rendered += 1
        directions = self.camera.rays() @ pose[:3, :3].T
        height = max(floor.height for floor in self.floors if floor.height < pose[1, 3])
        room = ROOM + np.array([0.0, height, 0.0])
        with np.errstate(divide="ignore"):
            distances = np.maximum((room[0] - pose[:3, 3]) / directions, (room[1] - pose[:3, 3]) / directions)
        depth, axis = distances.min(axis=-1), distances.argmin(axis=-1)
        points = pose[:3, 3] + directions * depth[..., None]
        phase = 0.1 * len(self.scene.identity) + np.array([2.0, 2.5, 3.0])
        waves = np.sin(phase * points[..., [0, 1, 2]]) * np.sin(phase * points[..., [1, 2, 0]] + 1.0)
        rgb = (127.5 + 120.0 * waves).astype(np.uint8)
        return Frame(rgb, depth.astype(np.float32), pose, axis.astype(np.int32) if Channel.LABELS in channels else None)

    def free_space(self, floor: int = 0) -> FreeSpace:
        frame = GridFrame(ROOM[0, 0], ROOM[0, 2], rows=40, columns=60, resolution=0.1)
        free = np.zeros(frame.shape, dtype=bool)
        free[3:-3, 3:-3] = True
        height = self.floors[floor].height
        return FreeSpace(frame, free, np.where(free, 1.0, 0.0).astype(np.float32), floor_height=height)


class Wanderer(Explorer):
    """Walks at random by the episode's seed and keeps what it was told and shown."""

    def __init__(self, needs: frozenset[Need] = frozenset(), stop_after: int | None = None) -> None:
        self.needs = needs
        self.stop_after = stop_after
        self.seen: list[Observation] = []

    def reset(self, episode: Episode) -> None:
        self.episode = episode
        self.rng = np.random.default_rng(episode.seed)

    def act(self, observation: Observation) -> Action:
        self.seen.append(observation)
        if observation.step == self.stop_after:
            return Action.STOP
        if observation.predicted_depth is not None:  # so that what the model says decides where the robot goes
            left, right = np.array_split(observation.predicted_depth, 2, axis=1)
            if left.sum() + self.rng.normal() > right.sum():
                return Action.LEFT
        return Action(self.rng.choice([0, 0, 1, 2]))

    def map(self) -> ExplorerMap:
        frame = GridFrame(0.0, 0.0, 2, 3)
        return ExplorerMap(frame, np.full(frame.shape, len(self.seen) % 100, np.int8))


class GuessingModel:
    """Predicts each frame's mean sparse depth, brighter pixels nearer; counts how it is called."""

    def __init__(self) -> None:
        self.batch_sizes: list[int] = []

    def __call__(self, image: Tensor, sparse_depth: Tensor, intrinsics: Tensor) -> Tensor:
        self.batch_sizes.append(len(image))
        assert intrinsics.shape == (len(image), 3, 3)
        mean = sparse_depth.sum(dim=(1, 2, 3)) / (sparse_depth > 0).sum(dim=(1, 2, 3))
        return mean[:, None, None, None] * (1.5 - image.mean(dim=1, keepdim=True))


class ConvolvingModel(DepthModel):
    """A small network whose sums are long enough for threads to share; its weights follow from a seed."""

    min_depth, max_depth = 0.1, 10.0

    def __init__(self) -> None:
        super().__init__()
        with torch.random.fork_rng():
            torch.manual_seed(0)
            self.inner = torch.nn.Conv2d(4, 64, 3, padding=1)
            self.outer = torch.nn.Conv2d(64, 1, 3, padding=1)

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        features = self.inner(torch.cat([image, sparse_depth], dim=1)).relu()
        return Prediction(2.0 + self.outer(features).sigmoid())


def convolving_predictor() -> FastPredictor:
    return FastPredictor(ConvolvingModel(), "cpu", "32-true")


def specification(**changes: object) -> DatasetSpec:
    settings = {
        "name": "toy",
        "scenes": (ToyScene("kitchen", "toy-1"), ToyScene("hall", "toy-22")),
        "explorer": "wanderer",
        "simulation": SIMULATION,
        "steps": 8,
        "seed": 3,
    }
    return DatasetSpec(**(settings | changes))  # type: ignore[arg-type]


def tree(folder: Path) -> dict[str, str]:
    """Hash of every file below a folder; the manifest without the seconds that it took."""
    hashes = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            content = path.read_bytes()
            if path.name == "manifest.json":
                content = content.split(b'"seconds"')[0]
            hashes[str(path.relative_to(folder))] = hashlib.sha256(content).hexdigest()
    return hashes


def guided_explorer() -> Wanderer:
    return Wanderer(frozenset({Need.SENSOR_DEPTH, Need.PREDICTED_DEPTH, Need.RESIDUAL, Need.LABELS}))


def run_travelled(run: JobRunner[P], jobs: Sequence[Job[P]], count: Count) -> None:
    """An executor that hands out pickles of all that it is given, the last job first, as to two other processes."""
    for job in reversed(share_out(jobs, 2, count)):
        there, sent = pickle.loads(pickle.dumps((run, job)))
        there(sent, count)


def slow_simulator(scene: ToyScene) -> ToySimulator:
    return ToySimulator(scene, delay=0.02)


def build_slowly(root: str) -> None:
    """Build a dataset and say so after each step; for processes that are to be killed."""
    from deux.collection.pipeline import build_dataset

    torch.set_num_threads(1)
    build_dataset(
        specification(model="guess", uncertainty=L1),
        Path(root),
        slow_simulator,
        guided_explorer,
        GuessingModel(),
        progress=lambda stage, done, total: print(stage, done, flush=True),
    )
