"""Benchmark of data loading: time that training steps wait for their batch, for each choice of `data.cache`."""

import logging
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import torch
from lightning.pytorch import Callback, LightningModule, Trainer

from deux.bench.bench_scenes import default_simulation, flats
from deux.bench.installed_plugins import default_model
from deux.bench.model_speed import KNOWN_WARNINGS
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.timing import Spread, in_turn
from deux.collection.sparse import SparseSettings, sample_sparse
from deux.contracts import Action, DepthModel
from deux.data.cache_choice import CacheChoice
from deux.data.datamodule import TripletDataModule
from deux.data.dataset_reader import DatasetReader
from deux.errors import DeuxError
from deux.inference.precision import default_precision
from deux.io.calibration import write_matrix
from deux.io.images import write_depth, write_image
from deux.io.layout import SequencePaths, frame_name, list_file
from deux.registry import registry
from deux.simulator.starts import random_starts
from deux.training.fit import make_trainer
from deux.training.module import DepthCompletion
from deux.training.objective import make_objective

_KNOWN_WARNINGS = (
    *KNOWN_WARNINGS,
    "This DataLoader will create",
    "You have overridden `on_after_batch_transfer`",
    "The combination of `DataLoader",
)

_NOTES = (
    "Waiting is the device's time from the end of a step to the arrival of the next batch, including a GPU's own "
    "operations on the batch.",
    "Host seconds are the time that the training process spends between two steps: making or receiving the batch, "
    "its transfer, and Lightning's own work. If steps are limited by Python, a GPU waits for all of it.",
)


class DataWaiting(Callback):
    """Callback that measures the time between the end of a step and the arrival of the next batch on the device.

    On a GPU, times are measured with CUDA events: work of the host only counts while the GPU is idle, and operations
    of the GPU on the batch count as waiting. On the CPU, wall time is measured. Validation between two steps is
    excluded.

    If steps are limited by the host, which then launches operations more slowly than the GPU executes them, the GPU is
    idle while the host prepares a batch. `host_waits` returns that time.

    Args:
        warm_up: number of steps at the start of training that are excluded, since they allocate memory and select
            algorithms.
    """

    def __init__(self, warm_up: int = 1) -> None:
        self._left_out = warm_up
        self._end: _Moment | None = None
        self._marks: list[_Mark] = []

    def on_train_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start to wait for the first batch of the epoch."""
        self._end = _Moment.now(pl_module.device)

    def on_train_batch_start(self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int) -> None:
        """Record the arrival of the batch."""
        assert self._end is not None
        self._marks.append(_Mark(trainer.current_epoch, self._end, _Moment.now(pl_module.device)))

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Record the end of the step and start to wait for the next batch."""
        self._end = self._marks[-1].end = _Moment.now(pl_module.device)

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start to wait for the next batch."""
        self._end = _Moment.now(pl_module.device)

    def waits(self, first_epoch: int = 0) -> list[float]:
        """Seconds that the device waited before each step, from `first_epoch` on."""
        return [mark.before.until(mark.arrival) for mark in self._counted(first_epoch)]

    def host_waits(self, first_epoch: int = 0) -> list[float]:
        """Seconds between the host's end of a step and its receipt of the next batch, from `first_epoch` on."""
        return [mark.arrival.host - mark.before.host for mark in self._counted(first_epoch)]

    def steps(self, first_epoch: int = 0) -> list[float]:
        """Duration of each step in seconds, without the wait for its batch, from `first_epoch` on."""
        return [mark.arrival.until(mark.end) for mark in self._counted(first_epoch) if mark.end is not None]

    def share(self, first_epoch: int = 0) -> float:
        """Fraction of the time that was spent waiting, from `first_epoch` on, in [0, 1]."""
        waited, worked = sum(self.waits(first_epoch)), sum(self.steps(first_epoch))
        return waited / (waited + worked)

    def _counted(self, first_epoch: int) -> "list[_Mark]":
        return [mark for mark in self._marks[self._left_out :] if mark.epoch >= first_epoch]


class _Moment(NamedTuple):
    """A point in time on the host, and on a GPU an event after all operations that were launched before."""

    host: float
    event: Any = None

    @classmethod
    def now(cls, device: torch.device) -> "_Moment":
        if device.type != "cuda":
            return cls(time.perf_counter())
        event = torch.cuda.Event(enable_timing=True)
        event.record(torch.cuda.current_stream(device))
        return cls(time.perf_counter(), event)

    def until(self, later: "_Moment") -> float:
        """Seconds on the device from this moment to a later one."""
        if self.event is None:
            return later.host - self.host
        later.event.synchronize()
        return float(self.event.elapsed_time(later.event)) / 1000.0


@dataclass
class _Mark:
    """Times of one step: end of the previous step, arrival of the batch and end of the step."""

    epoch: int
    before: _Moment
    arrival: _Moment
    end: _Moment | None = None


@dataclass(frozen=True)
class WaitingSettings:
    """Settings of the benchmark of data loading.

    Args:
        frames: number of training frames.
        size: height and width of the frames in pixels; samples are crops of three quarters of the size.
        batch_size: number of samples in a batch.
        epochs: number of epochs, at least 2. The table shows the later ones apart from the first, which reads files.
        rounds: number of trainings with each cache.
    """

    frames: int = 64
    size: int = 192
    batch_size: int = 4
    epochs: int = 3
    rounds: int = 3


QUICK = WaitingSettings(frames=12, size=64, batch_size=2, epochs=2, rounds=1)
"""Settings for a quick test."""


def measure_data_waiting(
    settings: WaitingSettings, model: str | None = None, accelerator: str = "auto"
) -> Iterator[SpeedTable]:
    """Train a model on rendered frames in files with each choice of `data.cache`.

    Args:
        settings: the settings of the benchmark.
        model: name of the depth model; None for the first installed model that trains without ground truth.
        accelerator: Lightning's accelerator setting.

    Raises:
        DeuxError: no depth model is installed.
    """
    name = model or default_model()
    if name is None:
        raise DeuxError("no depth model is installed that could be trained.")
    choices: tuple[CacheChoice, ...] = get_args(CacheChoice)
    with tempfile.TemporaryDirectory() as folder:
        dataset = write_frames(Path(folder) / "frames", settings.frames, settings.size)
        runs = {choice: partial(_train, name, dataset, choice, settings, accelerator) for choice in choices}
        found = in_turn(runs, settings.rounds)
    rows: tuple[dict[str, Value], ...] = tuple(
        {
            "data.cache": choice,
            "workers": str(found[choice][0].workers),
            "seconds per step": Spread.of([s for one in found[choice] for s in one.clock.steps(1)]),
            "host seconds per batch": Spread.of([s for one in found[choice] for s in one.clock.host_waits(1)]),
            "waiting, %": Spread.of([100 * one.clock.share(1) for one in found[choice]]),
            "in the first epoch, %": Spread.of([100 * one.clock.share() for one in found[choice]]),
        }
        for choice in choices
    )
    title = (
        f"Waiting for data: {name}, {settings.frames} frames of {settings.size} x {settings.size}, "
        f"batch {settings.batch_size}"
    )
    yield SpeedTable("data", title, rows, _NOTES)


def write_frames(folder: Path, count: int, size: int) -> Path:
    """Write a dataset in deux's layout whose training split is a random walk in a generated flat.

    Args:
        folder: folder of the new dataset.
        count: number of frames that have source frames.
        size: height and width of the frames in pixels.

    Returns:
        `folder`.
    """
    simulator = default_simulation(size).make(flats(1)[0])
    rng = np.random.default_rng(0)
    simulator.reset(*random_starts(simulator.free_space(), 1, rng)[0])
    paths = SequencePaths(folder / "data" / "flat-00")
    names = [frame_name(index) for index in range(count + 2)]
    for name in names:
        frame = simulator.observe()
        for kind in ("image", "sparse_depth", "ground_truth", "absolute_pose"):
            paths.file(kind, name).parent.mkdir(parents=True, exist_ok=True)
        write_image(paths.file("image", name), frame.rgb)
        write_depth(paths.file("sparse_depth", name), sample_sparse(frame.rgb, frame.depth, SparseSettings()))
        write_depth(paths.file("ground_truth", name), frame.depth)
        write_matrix(paths.file("absolute_pose", name), frame.pose)
        simulator.step((Action.FORWARD, Action.LEFT, Action.RIGHT)[int(rng.integers(3))])
    write_matrix(paths.intrinsics, simulator.camera.intrinsics)
    lines = [f"data/{paths.name}/image/{name}.png\n" for name in names]
    list_file(folder, "train", "image").write_text("".join(lines))
    return folder


@dataclass(frozen=True)
class _Run:
    clock: DataWaiting
    workers: int


def _train(name: str, dataset: Path, cache: CacheChoice, settings: WaitingSettings, accelerator: str) -> _Run:
    """Train a new model like `deux.training.fit`, without logs and checkpoints."""
    torch.manual_seed(0)
    model: DepthModel = registry().create("depth_models", name, {})
    objective = make_objective(model)
    crop = settings.size * 3 // 4
    readers = [DatasetReader(dataset)]
    data = TripletDataModule(
        model, readers, batch_size=settings.batch_size, crop=(crop, crop), cache=cache, sources=True, poses=True
    )
    clock = DataWaiting()
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        for message in _KNOWN_WARNINGS:
            warnings.filterwarnings("ignore", message)
        trainer = make_trainer(
            {
                "accelerator": accelerator,
                "precision": default_precision(accelerator),
                "devices": 1,
                "max_epochs": settings.epochs,
                "callbacks": [clock],
                "logger": False,
                "enable_checkpointing": False,
                "enable_progress_bar": False,
                "enable_model_summary": False,
                "limit_val_batches": 0,
                "use_distributed_sampler": False,
                "reload_dataloaders_every_n_epochs": 1,
            }
        )
        trainer.fit(DepthCompletion(model, objective, cuda_graphs=True), datamodule=data)
    return _Run(clock, data.train_dataloader().num_workers)
