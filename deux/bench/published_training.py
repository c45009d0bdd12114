"""Benchmark of training steps against the implementation of the depth models' published code.

The published code uses square pooling windows, upsampling before convolution, channels-first tensors, float32,
PyTorch's default Adam and its own training loop. Networks, losses and samples are the same.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import torch

from deux.bench.installed_plugins import installed
from deux.bench.model_speed import PRECISIONS, StepVariant, train_steps
from deux.bench.rendered_batch import batch_on, render_batch
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.step_clock import MeanStep
from deux.bench.timing import Spread, Stopwatch, in_turn
from deux.contracts import Batch, DepthModel
from deux.geometry.sparse_outliers import remove_outliers
from deux.geometry.tuned_forms import reference_forms
from deux.inference.precision import default_device, default_precision
from deux.registry import registry
from deux.training.objective import make_objective
from deux.training.pose_source import make_pose_source


@dataclass(frozen=True)
class PublishedSettings:
    """Settings of the benchmark against published code.

    Args:
        batch_size: number of samples in a batch; None for 2 on the CPU and 8 on a GPU.
        size: height and width of the samples in pixels; None for 192 on the CPU and 384 on a GPU.
        steps: number of training steps in a round, after one warm-up step; None for 3 on the CPU and 20 on a GPU.
        rounds: number of measurements of each implementation.
    """

    batch_size: int | None = None
    size: int | None = None
    steps: int | None = None
    rounds: int = 5


QUICK = PublishedSettings(batch_size=1, size=128, steps=1, rounds=2)
"""Settings for a quick test."""


def measure_published_training(settings: PublishedSettings, accelerator: str = "auto") -> Iterator[SpeedTable]:
    """Measure training steps of every installed depth model in deux and in the published implementation.

    Args:
        settings: the settings of the benchmark.
        accelerator: Lightning's accelerator setting.
    """
    models, broken = installed("depth_models")
    device = default_device(accelerator)
    size = settings.size or (384 if device.type == "cuda" else 192)
    batch_size = settings.batch_size or (8 if device.type == "cuda" else 2)
    steps = settings.steps or (20 if device.type == "cuda" else 3)
    trained_in = default_precision(accelerator)
    precision = next(name for name, lightning_name in PRECISIONS.items() if lightning_name == trained_in)
    rows: list[dict[str, Value]] = []
    for name, model in models.items():
        variant = StepVariant(name, precision, "simulator" if model.pose_network() is None else "learned")
        batch = render_batch(model, size, batch_size)
        ways = {
            "published": partial(_published_step, variant, batch, steps, device),
            "deux": partial(_our_step, variant, batch, steps, accelerator),
        }
        found = in_turn(ways, settings.rounds)
        ratios = [theirs / ours for theirs, ours in zip(found["published"], found["deux"], strict=True)]
        rows.append(
            {
                "model": name,
                "poses": variant.poses,
                "precision": precision,
                "as published, s": Spread.of(found["published"]),
                "deux, s": Spread.of(found["deux"]),
                "times as fast": Spread.of(ratios),
            }
        )
    note = (
        "As published: float32, channels first, square pools, upsampling before convolution, unfused Adam, no Trainer. "
        "Each number is the mean step of a round. On a GPU, deux replays its steps as CUDA graphs."
    )
    title = f"Training steps compared with steps computed as published, batch {batch_size}, {size} x {size}"
    yield SpeedTable("published", title, tuple(rows), (note, *broken))


def _our_step(variant: StepVariant, batch: Batch, steps: int, accelerator: str) -> float:
    """Mean duration of a training step of deux in seconds."""
    train_steps(variant, batch, steps, clock := MeanStep(), accelerator, cuda_graphs=True)
    return clock.seconds


def _published_step(variant: StepVariant, batch: Batch, steps: int, device: torch.device) -> float:
    """Mean duration of a training step of the published implementation in seconds."""
    torch.manual_seed(0)
    model: DepthModel = registry().create("depth_models", variant.model, {})
    modules = torch.nn.ModuleList([model, make_pose_source(variant.poses, model), make_objective(model)])
    modules.to(device).train()
    for parameter in modules.parameters():
        parameter.data = parameter.data.contiguous()
    network, pose_source, objective = modules
    optimizer = torch.optim.Adam([weight for weight in modules.parameters() if weight.requires_grad], lr=1e-4)
    watch, seen = Stopwatch(), batch_on(device, batch)
    for number in range(steps + 1):
        if number == 1:
            watch.start("steps")
        with reference_forms():
            shown = replace(seen, validity=seen.validity * remove_outliers(seen.sparse_depth))
            prediction = network(shown.image, shown.sparse_depth, shown.validity, shown.intrinsics, **shown.prepared)
            compares = objective.needs_reconstructions
            poses = pose_source(shown, backward=objective.needs_backward_poses) if compares else None
            loss = objective(shown, prediction, poses).total
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    watch.stop("steps")
    return watch.total("steps") / steps
