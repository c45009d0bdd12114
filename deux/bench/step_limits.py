"""Benchmark of the limits of training steps: arithmetic of convolutions, memory bandwidth or Python."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from lightning.pytorch import Callback, Trainer
from torch.profiler import ProfilerActivity, profile
from torch.utils.flop_counter import FlopCounterMode

from deux.bench.installed_plugins import installed
from deux.bench.model_speed import PRECISIONS, StepVariant, train_steps
from deux.bench.rendered_batch import render_batch
from deux.bench.speed_tables import SpeedTable, Value
from deux.bench.step_clock import StepClock
from deux.bench.timing import Spread, Stopwatch
from deux.contracts import Batch
from deux.inference.precision import default_device, default_precision

_DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16}
_PRODUCTS = ("convolution", "conv2d", "mkldnn", "cudnn", "mm", "linear", "matmul")  # parts of operator names
_SIDE = 2048  # size of the square matrices of `best_product_rate`
_COPIED = 2**28  # bytes; larger than all caches


@dataclass(frozen=True)
class LimitSettings:
    """Settings of the benchmark of limits.

    Args:
        batch_size: number of samples in a batch.
        size: height and width of the samples in pixels.
        steps: number of training steps that are timed, and number of those that are profiled.
        repeats: number of measurements of the device's peak rates.
    """

    batch_size: int = 2
    size: int = 192
    steps: int = 4
    repeats: int = 5


QUICK = LimitSettings(batch_size=1, size=128, steps=2, repeats=2)
"""Settings for a quick test."""


def measure_limits(settings: LimitSettings, accelerator: str = "auto") -> Iterator[SpeedTable]:
    """Measure the composition of training steps of every installed depth model.

    Training uses deux's default precision for the device, and learned poses if the model has a pose network.

    Args:
        settings: the settings of the benchmark.
        accelerator: Lightning's accelerator setting.
    """
    models, broken = installed("depth_models")
    device = default_device(accelerator)
    trained_in = default_precision(accelerator)
    precision = next(name for name, lightning_name in PRECISIONS.items() if lightning_name == trained_in)
    best = best_product_rate(device, _DTYPES[precision], settings.repeats)
    rows: list[dict[str, Value]] = []
    for name, model in models.items():
        variant = StepVariant(name, precision, "simulator" if model.pose_network() is None else "learned")
        batch = render_batch(model, settings.size, settings.batch_size)
        rows.append(_row(variant, batch, settings.steps, accelerator, best.median))
    bandwidth = best_bandwidth(device, settings.repeats)
    notes = (
        f"The best rate here is that of the product of two {_SIDE} x {_SIDE} matrices in {precision}: {best} GFLOP/s; "
        f"memory is copied at {bandwidth} GB/s. Products are convolutions and matrix products, limited by arithmetic; "
        "other operations read and write their tensors once and are limited by memory; the rest is Python, Lightning "
        "and the launch of operations, during which a GPU is idle.",
        *broken,
    )
    shape = f"batch {settings.batch_size}, {settings.size} x {settings.size}"
    yield SpeedTable("limits", f"What limits a training step at {shape}", tuple(rows), notes)


def best_product_rate(device: torch.device, dtype: torch.dtype, repeats: int) -> Spread:
    """Measure the GFLOP/s of the product of two large square matrices."""
    a, b = (torch.randn(_SIDE, _SIDE, device=device).to(dtype) for _ in range(2))
    return Spread.of([2e-9 * _SIDE**3 / second for second in _seconds(lambda: a @ b, repeats)])


def best_bandwidth(device: torch.device, repeats: int) -> Spread:
    """Measure the memory bandwidth of a copy in GB/s; each byte counts as one read and one write."""
    source = torch.zeros(_COPIED, dtype=torch.uint8, device=device)
    target = torch.empty_like(source)
    return Spread.of([2e-9 * _COPIED / second for second in _seconds(lambda: target.copy_(source), repeats)])


def _seconds(call: Any, repeats: int) -> list[float]:
    watch = Stopwatch()
    call()
    for _ in range(repeats):
        with watch.measure("call"):
            call()
    return watch.durations["call"]


def _row(variant: StepVariant, batch: Batch, steps: int, accelerator: str, best: float) -> dict[str, Value]:
    """Measure a depth model and create its row of the table."""
    clock, flops, shares = StepClock(parts=False), _FlopCount(), _OperationShares()
    for watch, count in ((flops, 1), (clock, steps), (shares, steps)):
        train_steps(variant, batch, count, watch, accelerator)
    limits = {"flops": shares.products, "memory": shares.others, "Python": 100.0 - shares.products - shares.others}
    return {
        "model": variant.model,
        "poses": variant.poses,
        "GFLOP": f"{flops.gflops:.1f}",
        "seconds per step": Spread.of(clock.steps),
        "seconds at the best rate": f"{flops.gflops / best:.4f}",
        "products, %": f"{shares.products:.0f}",
        "other operations, %": f"{shares.others:.0f}",
        "rest, %": f"{limits['Python']:.0f}",
        "limited by": max(limits, key=limits.__getitem__),
    }


class _FlopCount(Callback):
    """Callback that counts the floating-point operations of convolutions and matrix products in the last step."""

    gflops = 0.0

    def on_train_batch_start(self, *_: Any) -> None:
        self._counter = FlopCounterMode(display=False)
        self._counter.__enter__()

    def on_train_batch_end(self, *_: Any) -> None:
        self._counter.__exit__(None, None, None)
        self.gflops = self._counter.get_total_flops() / 1e9


class _OperationShares(Callback):
    """Callback that measures the shares of products and of all other operations in the time of steps, in %.

    The first step is excluded. On a GPU, the time of an operation is that of its kernels, and the remaining share is
    time without a running kernel.
    """

    products = others = 0.0

    def __init__(self) -> None:
        self._watch = Stopwatch()
        self._profile: profile | None = None

    def on_train_batch_end(self, trainer: Trainer, *_: Any) -> None:
        if self._profile is None:
            cuda = [ProfilerActivity.CUDA] if torch.cuda.is_initialized() else []
            self._profile = profile(activities=[ProfilerActivity.CPU, *cuda], acc_events=True)
            self._profile.__enter__()
            self._watch.start("steps")
        elif trainer.global_step == trainer.max_steps:
            self._watch.stop("steps")
            self._profile.__exit__(None, None, None)
            self._count(self._profile)

    def _count(self, found: profile) -> None:
        cuda = ProfilerActivity.CUDA in found.activities
        wall = self._watch.total("steps")
        for event in found.key_averages():
            if not event.key.startswith(("aten::", "torch::", "_")):  # recorded by autograd or Lightning
                continue
            share = 100e-6 * (event.self_device_time_total if cuda else event.self_cpu_time_total) / wall
            if any(word in event.key for word in _PRODUCTS):
                self.products += share
            else:
                self.others += share
