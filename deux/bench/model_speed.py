"""Benchmark of depth models: duration of training steps and of their parts, and of inference."""

import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Literal, NamedTuple

import torch
from lightning import Callback, Trainer
from torch import Tensor
from torch.utils.data import DataLoader

from deux.bench.installed_plugins import installed
from deux.bench.rendered_batch import batch_on, render_batch
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.step_clock import PARTS, StepClock
from deux.bench.timing import Spread, Stopwatch, in_turn, times_the_slowest
from deux.contracts import Batch, DepthModel
from deux.inference.precision import default_device
from deux.registry import registry
from deux.training.module import DepthCompletion
from deux.training.objective import make_objective
from deux.training.pose_source import PoseKind, make_pose_source

PRECISIONS: dict[str, Literal["32-true", "bf16-mixed"]] = {"float32": "32-true", "bfloat16": "bf16-mixed"}
"""Lightning's names of the precisions."""

POSES: tuple[PoseKind, ...] = ("simulator", "learned")

# Warnings of Lightning about missing validation data and loader processes, and about its own code.
KNOWN_WARNINGS = (
    "You defined a `validation_step`",
    ".*does not have many workers",
    r"Found \d+ module\(s\) in eval mode",
    r"`isinstance\(treespec, LeafSpec\)`",
)


@dataclass(frozen=True)
class ModelSettings:
    """Settings of the benchmark of depth models.

    Args:
        batch_size: number of samples in a batch.
        size: height and width of the samples in pixels.
        steps: number of training steps in a round, after one warm-up step.
        inference_size: height and width of the image for inference.
        rounds: number of measurements of each variant.
    """

    batch_size: int = 2
    size: int = 192
    steps: int = 3
    inference_size: int = 384
    rounds: int = 5


QUICK = ModelSettings(batch_size=1, size=128, steps=1, inference_size=128, rounds=2)
"""Settings for a quick test."""


def measure_models(settings: ModelSettings, accelerator: str = "auto") -> Iterator[SpeedTable]:
    """Measure every installed depth model with its published objective and default options.

    Args:
        settings: the settings of the benchmark.
        accelerator: Lightning's accelerator setting.
    """
    models, broken = installed("depth_models")
    notes = broken if models else (*broken, "no depth model is installed.")
    yield from _step_tables(settings, models, notes, accelerator)
    yield _inference_table(settings, models, notes, default_device(accelerator))


class StepVariant(NamedTuple):
    """A depth model and the options of its training.

    Args:
        model: registered name of the model.
        precision: a key of `PRECISIONS`.
        poses: source of the relative poses.
    """

    model: str
    precision: str
    poses: PoseKind


def _step_tables(
    settings: ModelSettings, models: dict[str, DepthModel], notes: tuple[str, ...], accelerator: str
) -> Iterator[SpeedTable]:
    """Measure the duration of training steps and the shares of their parts."""
    variants = [
        StepVariant(name, precision, poses)
        for (name, model), precision, poses in product(models.items(), PRECISIONS, POSES)
        if poses == "simulator" or model.pose_network() is not None
    ]
    batches = {name: render_batch(model, settings.size, settings.batch_size) for name, model in models.items()}

    def run(variant: StepVariant) -> StepClock:
        train_steps(variant, batches[variant.model], settings.steps, clock := StepClock(), accelerator)
        return clock

    found = in_turn({variant: partial(run, variant) for variant in variants}, settings.rounds)
    seconds = {variant: [step for clock in found[variant] for step in clock.steps] for variant in variants}
    ratios = times_the_slowest({variant: [1.0 / step for step in seconds[variant]] for variant in variants})
    shape = f"batch {settings.batch_size}, {settings.size} x {settings.size}"
    steps = tuple(
        {**variant._asdict(), "seconds per step": Spread.of(seconds[variant]), "times the slowest": ratios[variant]}
        for variant in variants
    )
    yield SpeedTable("models", f"Training steps: forward, losses, backward and Adam at {shape}", steps, notes)
    parts = tuple({**variant._asdict(), **_shares(found[variant])} for variant in variants)
    yield SpeedTable("models_parts", "Training steps: where their time goes", parts)


def train_steps(
    variant: StepVariant,
    batch: Batch,
    steps: int,
    watch: Callback,
    accelerator: str = "auto",
    cuda_graphs: bool = False,
) -> None:
    """Train a new model for a few steps like `deux.training.fit`, without loading data and writing logs.

    Args:
        variant: the model and the options of its training.
        batch: the batch of all steps.
        steps: number of steps, after one warm-up step.
        watch: callback that measures the steps.
        accelerator: Lightning's accelerator setting.
        cuda_graphs: whether a GPU replays the steps as CUDA graphs, which is the default of training. The parts of a
            step cannot be measured then.
    """
    torch.manual_seed(0)
    batch = batch_on(default_device(accelerator), batch)  # outside the measured steps
    model: DepthModel = registry().create("depth_models", variant.model, {})
    poses = make_pose_source(variant.poses, model)
    module = DepthCompletion(model, make_objective(model), poses, cuda_graphs=cuda_graphs)
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        for message in KNOWN_WARNINGS:
            warnings.filterwarnings("ignore", message)
        trainer = Trainer(
            accelerator=accelerator,
            precision=PRECISIONS[variant.precision],
            devices=1,
            max_steps=steps + 1,
            callbacks=[watch],
            logger=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
        )
        trainer.fit(module, DataLoader([batch] * (steps + 1), batch_size=None))  # type: ignore[arg-type]


def _shares(clocks: Sequence[StepClock]) -> dict[str, Spread]:
    return {
        f"{part}, %": Spread.of([share for clock in clocks for share in clock.shares[part]])
        for part in (*PARTS, "rest")
    }


def _inference_table(
    settings: ModelSettings, models: Mapping[str, DepthModel], notes: tuple[str, ...], device: torch.device
) -> SpeedTable:
    """Measure `DepthModel.predict` for one image, with the preparation of the model's inputs."""
    size = settings.inference_size
    calls = {}
    for name, model in models.items():
        batch = render_batch(model, size, count=1)
        inputs = [tensor.to(device) for tensor in (batch.image, batch.sparse_depth, batch.intrinsics)]
        for precision in PRECISIONS:
            calls[name, precision] = partial(_predict, model.eval().to(device), inputs, precision)
    for call in calls.values():  # warm-up: allocates memory and selects algorithms
        call()
    found = in_turn(calls, settings.rounds)
    ratios = times_the_slowest({variant: [1.0 / second for second in found[variant]] for variant in calls})
    rows: tuple[dict[str, Value], ...] = tuple(
        {
            "model": name,
            "precision": precision,
            "seconds per image": Spread.of(found[name, precision]),
            "times the slowest": ratios[name, precision],
        }
        for name, precision in calls
    )
    return SpeedTable("inference", f"Inference: one image of {size} x {size}", rows, notes)


def _predict(model: DepthModel, inputs: Sequence[Tensor], precision: str) -> float:
    """Duration of one prediction in seconds."""
    watch = Stopwatch()
    autocast = torch.autocast(inputs[0].device.type, torch.bfloat16, enabled=precision == "bfloat16")
    with autocast, watch.measure("prediction"):
        model.predict(*inputs)
    return watch.total("prediction")
