"""The errors of a depth model and of the two baselines that it is compared with, on the same frames."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from deux.contracts import Batch, DepthModel
from deux.errors import DeuxError
from deux.geometry.scaffolding import interpolate
from deux.metrics.depth_errors import DepthErrors, invalid_pixels

LEAST_DEPTH = 1e-3
"""Metres that a baseline predicts where it has no sparse point to go by: 0 has no inverse."""


@dataclass(frozen=True)
class Evaluation:
    """Mean errors over a set of frames, each a dictionary with the keys of `deux.metrics.depth_errors.METRICS`.

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
        DeuxError: there is no frame, none has ground truth in range, or a prediction is not finite or not above 0 at a
            pixel with ground truth.
    """
    errors = {name: DepthErrors(min_depth, max_depth, alone=True) for name in ("metrics", "baseline", "constant")}
    device = next(model.parameters()).device
    images = 0
    for batch in batches:
        if batch.ground_truth is None:
            raise DeuxError("evaluation needs ground truth, and these frames were loaded without it.")
        truth = batch.ground_truth.cpu()
        predicted = model.predict(batch.image.to(device), batch.sparse_depth.to(device), batch.intrinsics.to(device))
        predicted = predicted.float().cpu()
        _check_predictions(invalid_pixels(predicted, truth, min_depth, max_depth), images)
        errors["metrics"].update(predicted, truth)
        errors["baseline"].update(_densify(interpolate, batch.sparse_depth), truth)
        errors["constant"].update(_densify(median_depth, batch.sparse_depth), truth)
        images += len(truth)
        if progress is not None:
            progress(len(truth))
    if images == 0 or int(errors["metrics"].images.item()) == 0:
        raise DeuxError(
            f"none of the {images} test frames has ground truth between {min_depth} and {max_depth} m: "
            "collect more viewpoints or widen the evaluation range."
        )
    means = {key: {n: v.item() for n, v in metric.compute().items()} for key, metric in errors.items()}
    return Evaluation(**means, images=images)


def median_depth(sparse_depth: np.ndarray) -> np.ndarray:
    """A depth map without any shape: the median of the sparse points everywhere.

    Args:
        sparse_depth: H x W metres, 0 = none.

    Returns:
        H x W float32 metres; 0 everywhere without any point.
    """
    points = sparse_depth[sparse_depth > 0]
    return np.full(sparse_depth.shape, np.median(points) if points.size else 0.0, np.float32)


def _densify(baseline: Callable[[np.ndarray], np.ndarray], sparse_depth: Tensor) -> Tensor:
    """Apply a baseline to each of N x 1 x H x W metres, at least `LEAST_DEPTH`."""
    dense = np.stack([baseline(one) for one in sparse_depth[:, 0].cpu().numpy()])
    return torch.from_numpy(dense).clamp_min(LEAST_DEPTH)[:, None]


def _check_predictions(invalid: Tensor, before: int) -> None:
    """Raise DeuxError if a frame of a batch has invalid pixels; `before` is the number of frames before the batch."""
    for index, pixels in enumerate(invalid.tolist()):
        if pixels:
            raise DeuxError(
                f"the predicted depth of test frame {before + index} (the first is 0) is not finite or not above 0 at "
                f"{pixels} pixels with ground truth, so it has no errors: evaluate another checkpoint, or mend the "
                "model."
            )
