"""Evaluation of a depth model, of its depth corrected by the points, and of two baselines on the same frames."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from deux.contracts import Batch, DepthModel
from deux.errors import DeuxError, counted
from deux.geometry.depth_correction import correct_depth
from deux.geometry.scaffolding import interpolate
from deux.inference.prediction import device_of
from deux.metrics.depth_errors import METRICS, depth_errors, invalid_pixels
from deux.metrics.mean_errors import DepthErrors


@dataclass(frozen=True)
class SceneErrors:
    """Mean errors over the frames of one scene, or of one of its floors, rounded to three decimals.

    Args:
        scene: name of the scene or floor, see `deux.collection.specification.place_name`.
        frames: number of frames with ground truth in range, over which the means are computed.
        metrics: errors of the model by the names of `deux.metrics.depth_errors.METRICS`.
        baseline: errors of linear interpolation.
    """

    scene: str
    frames: int
    metrics: dict[str, float]
    baseline: dict[str, float]


@dataclass(frozen=True)
class Evaluation:
    """Mean errors over a set of frames, as dictionaries with the keys of `deux.metrics.depth_errors.METRICS`.

    For frames without sparse points, both baselines predict the median of the other frames' medians. They are NaN if
    no frame has sparse points.

    Args:
        metrics: errors of the model.
        corrected: errors of its depth corrected by the sparse points (`deux.geometry.depth_correction`).
        baseline: errors of the linear interpolation of the sparse points.
        constant: errors of a constant depth, the median of each frame's sparse points.
        images: number of frames.
        without_truth: number of frames without ground truth in range, which are in no mean.
        without_points: number of frames without sparse points.
        scenes: errors of each scene, sorted by name; empty if the scenes were not passed.
    """

    metrics: dict[str, float]
    corrected: dict[str, float]
    baseline: dict[str, float]
    constant: dict[str, float]
    images: int
    without_truth: int = 0
    without_points: int = 0
    scenes: list[SceneErrors] = field(default_factory=list)


def evaluate(
    model: DepthModel,
    batches: Iterable[Batch],
    min_depth: float = 0.1,
    max_depth: float = 10.0,
    progress: Callable[[int], None] | None = None,
    scenes: Sequence[str] = (),
) -> Evaluation:
    """Evaluate a depth model in float32 on batches with ground truth. Source frames are not used.

    Args:
        model: the model; its device and mode are not changed.
        batches: contracts.Batch with `ground_truth`.
        min_depth: ground truth at or below it is ignored, metres.
        max_depth: ground truth at or above it is ignored, metres.
        progress: called after each batch with its number of frames.
        scenes: scene name of each frame, in the order of the batches; empty for no errors by scene.

    Raises:
        DeuxError: no frame has ground truth in range, or a prediction is not finite or not above 0 at a pixel with
            ground truth.
    """
    errors, corrected = (DepthErrors(min_depth, max_depth, alone=True) for _ in range(2))
    baselines = _Baselines(min_depth, max_depth)
    device = device_of(model)
    images, farthest = 0, 0.0
    frame_errors: list[dict[str, float]] = []
    for batch in batches:
        if batch.ground_truth is None:
            raise DeuxError("evaluation needs ground truth, but these frames were loaded without it.")
        truth, points = batch.ground_truth.cpu(), batch.sparse_depth.cpu()
        predicted = model.predict(batch.image.to(device), batch.sparse_depth.to(device), batch.intrinsics.to(device))
        predicted = predicted.float().cpu()
        _check_predictions(invalid_pixels(predicted, truth, min_depth, max_depth), images)
        errors.update(predicted, truth)
        corrected.update(correct_depth(predicted, points), truth)
        if scenes:
            frame_errors += _frame_errors(predicted, truth, min_depth, max_depth)
        baselines.update(points, truth)
        images, farthest = images + len(truth), max(farthest, float(truth.max()))
        if progress is not None:
            progress(len(truth))
    in_means = int(errors.images.item())
    if in_means == 0:
        raise _no_truth_error(images, farthest, min_depth, max_depth)
    baseline, constant = baselines.compute()
    by_scene = _by_scene(scenes, frame_errors, baselines.frame_errors)
    without_points = len(baselines.without_points)
    return Evaluation(
        metrics=_means(errors),
        corrected=_means(corrected),
        baseline=baseline,
        constant=constant,
        images=images,
        without_truth=images - in_means,
        without_points=without_points,
        scenes=by_scene,
    )


def _no_truth_error(images: int, farthest: float, min_depth: float, max_depth: float) -> DeuxError:
    """The error for a test set without ground truth in range, whose largest depth is `farthest` metres."""
    message = f"none of the {counted(images, 'test frame')} has ground truth"
    if farthest == 0.0:
        return DeuxError(f"{message}: the maps contain only 0, which means no value.")
    return DeuxError(
        f"{message} between {min_depth} and {max_depth} m, the evaluated range: its maximum is {farthest:.4g} m, "
        "and camera.min_depth and camera.max_depth set the range."
    )


class _Baselines:
    """Errors of the interpolated sparse points and of their median; the arguments are those of `evaluate`."""

    def __init__(self, min_depth: float, max_depth: float) -> None:
        self.interpolated, self.constant = (DepthErrors(min_depth, max_depth, alone=True) for _ in range(2))
        self.without_points: dict[int, Tensor] = {}  # their ground truth, H x W, by frame number
        self._medians: list[float] = []
        self._range = min_depth, max_depth
        self._interpolated: dict[int, dict[str, float]] = {}
        self._seen = 0

    @property
    def frame_errors(self) -> list[dict[str, float]]:
        """The interpolation's errors of each frame in order, after `compute`."""
        return [errors for _, errors in sorted(self._interpolated.items())]

    def update(self, sparse_depth: Tensor, truth: Tensor) -> None:
        """Add a batch of sparse depth and ground truth, both N x 1 x H x W metres."""
        for points, known in zip(sparse_depth[:, 0].numpy(), truth[:, 0], strict=True):
            number, self._seen = self._seen, self._seen + 1
            if not points.any():
                self.without_points[number] = known
                continue
            median = float(np.median(points[points > 0]))
            self._medians.append(median)
            self._count_interpolated(number, torch.from_numpy(interpolate(points)), known)
            self._count(self.constant, torch.full_like(known, median), known)

    def compute(self) -> tuple[dict[str, float], dict[str, float]]:
        """Mean errors of the interpolation and of the median, including frames without points."""
        for number, known in self.without_points.items() if self._medians else ():
            depth = torch.full_like(known, float(np.median(self._medians)))
            self._count_interpolated(number, depth, known)
            self._count(self.constant, depth, known)
        return _means(self.interpolated), _means(self.constant)

    def _count_interpolated(self, number: int, depth: Tensor, truth: Tensor) -> None:
        self._count(self.interpolated, depth, truth)
        (self._interpolated[number],) = _frame_errors(depth[None, None], truth[None, None], *self._range)

    @staticmethod
    def _count(errors: DepthErrors, depth: Tensor, truth: Tensor) -> None:
        errors.update(depth[None, None], truth[None, None])


def _frame_errors(depth: Tensor, truth: Tensor, min_depth: float, max_depth: float) -> list[dict[str, float]]:
    """Errors of each image of a batch; NaN without ground truth in range."""
    errors = depth_errors(depth, truth, min_depth, max_depth)
    return [dict(zip(errors, values, strict=True)) for values in torch.stack(list(errors.values()), dim=1).tolist()]


def _by_scene(
    scenes: Sequence[str], metrics: Sequence[dict[str, float]], baseline: Sequence[dict[str, float]]
) -> list[SceneErrors]:
    """Mean errors by scene; empty without scene names or without an interpolation."""
    if not scenes or not baseline:
        return []
    frames_by_scene: dict[str, list[int]] = {}
    for index, (scene, errors) in enumerate(zip(scenes, metrics, strict=True)):
        if not math.isnan(errors["mae"]):
            frames_by_scene.setdefault(scene, []).append(index)

    def mean(errors: Sequence[dict[str, float]], frames: list[int]) -> dict[str, float]:
        return {name: round(sum(errors[frame][name] for frame in frames) / len(frames), 3) for name in METRICS}

    return [
        SceneErrors(scene, len(frames), mean(metrics, frames), mean(baseline, frames))
        for scene, frames in sorted(frames_by_scene.items())
    ]


def _means(errors: DepthErrors) -> dict[str, float]:
    """The mean of each metric; NaN without frames, where torchmetrics would warn."""
    if not errors.update_called:
        return dict.fromkeys(METRICS, math.nan)
    return {name: value.item() for name, value in errors.compute().items()}


def _check_predictions(invalid: Tensor, before: int) -> None:
    """Raise DeuxError if a frame has invalid pixels; `before` is the number of frames before the batch."""
    for index, pixels in enumerate(invalid.tolist()):
        if pixels:
            raise DeuxError(
                f"the predicted depth of test frame {before + index} (the first is 0) is not finite or not above 0 at "
                f"{counted(pixels, 'pixel')} with ground truth, so that its errors are undefined: evaluate another "
                "checkpoint or fix the model."
            )
