"""Measure a depth model, and what it has to be compared with, on the same frames."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from deux.contracts import Batch, DepthModel
from deux.errors import DeuxError
from deux.geometry.scaffolding import interpolate
from deux.metrics.baseline import constant
from deux.metrics.depth_errors import DepthMetrics


@dataclass(frozen=True)
class Evaluation:
    """Errors over a set of frames, each a dict of mae, rmse (mm), imae, irmse (1/km).

    Args:
        metrics: the model's.
        baseline: linear interpolation of the sparse points.
        constant: the median of each frame's sparse points.
        images: number of frames.
    """

    metrics: dict[str, float]
    baseline: dict[str, float]
    constant: dict[str, float]
    images: int


def evaluate(
    model: DepthModel,
    batches: Iterable[Batch],
    min_depth: float = 0.1,
    max_depth: float = 10.0,
    progress: Callable[[int], None] | None = None,
) -> Evaluation:
    """Run `model` over batches that carry ground truth, in float32.

    Args:
        model: stays on its device and in its mode.
        batches: contracts.Batch with `ground_truth`.
        min_depth: ground truth at or below it is left out, metres.
        max_depth: ground truth at or above it is left out, metres.
        progress: called after each batch with the number of frames in it.

    Raises:
        DeuxError: there is no frame, or none has ground truth in range.
    """
    meters = {name: DepthMetrics(min_depth, max_depth, alone=True) for name in ("metrics", "baseline", "constant")}
    images = 0
    for batch in batches:
        if batch.ground_truth is None:
            raise DeuxError("evaluation needs ground truth, and these frames were loaded without it.")
        truth = batch.ground_truth.cpu()
        device = next(model.parameters()).device
        predicted = model.predict(batch.image.to(device), batch.sparse_depth.to(device), batch.intrinsics.to(device))
        meters["metrics"].update(predicted.float().cpu(), truth)
        meters["baseline"].update(_each(interpolate, batch.sparse_depth), truth)
        meters["constant"].update(_each(constant, batch.sparse_depth), truth)
        images += len(truth)
        if progress is not None:
            progress(len(truth))
    if images == 0 or int(meters["metrics"].images.item()) == 0:
        raise DeuxError(
            f"none of the {images} test frames has ground truth between {min_depth} and {max_depth} m: "
            "collect more viewpoints or widen the evaluation range."
        )
    numbers = {key: {n: v.item() for n, v in meter.compute().items()} for key, meter in meters.items()}
    return Evaluation(**numbers, images=images)


def _each(densify: Callable[[np.ndarray], np.ndarray], sparse_depth: Tensor) -> Tensor:
    """Densify each of N x 1 x H x W; a frame without points gets 1 mm, not 0, which has no inverse."""
    dense = np.stack([densify(one) for one in sparse_depth[:, 0].cpu().numpy()])
    return torch.from_numpy(dense).clamp_min(1e-3)[:, None]
