"""The errors of a depth model and of the two baselines that it is compared with, on the same frames."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from deux.contracts import Batch, DepthModel
from deux.errors import DeuxError, counted
from deux.geometry.scaffolding import interpolate
from deux.inference.prediction import device_of
from deux.metrics.depth_errors import METRICS, depth_errors, invalid_pixels
from deux.metrics.mean_errors import DepthErrors


@dataclass(frozen=True)
class SceneErrors:
    """Mean errors over the frames of one scene, or of one floor of it, rounded to a thousandth.

    Args:
        scene: its name, or that of the floor, as of `deux.collection.specification.place_name`.
        frames: number of frames in the means: those with ground truth in range.
        metrics: the model's, by the names of `deux.metrics.depth_errors.METRICS`.
        baseline: linear interpolation's.
    """

    scene: str
    frames: int
    metrics: dict[str, float]
    baseline: dict[str, float]


@dataclass(frozen=True)
class Evaluation:
    """Mean errors over a set of frames, each a dictionary with the keys of `deux.metrics.depth_errors.METRICS`.

    A frame without any sparse point has no interpolation and no median of its own: both baselines then predict the
    median depth of the set, that of the other frames' medians. They are NaN if no frame has a point.

    Args:
        metrics: the model's.
        baseline: linear interpolation of the sparse points.
        constant: the median of each frame's sparse points.
        images: number of frames.
        without_truth: number of those that count in no mean, since they have no ground truth in range.
        without_points: number of those that have no sparse point.
        scenes: the errors scene by scene, by name, where the frames' scenes were told.
    """

    metrics: dict[str, float]
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
    """Run `model` over batches that carry ground truth, in float32. Source frames are not looked at.

    Args:
        model: stays on its device and in its mode.
        batches: contracts.Batch with `ground_truth`.
        min_depth: ground truth at or below it is left out, metres.
        max_depth: ground truth at or above it is left out, metres.
        progress: called after each batch with the number of frames in it.
        scenes: the name of each frame's scene, in the order of the batches; empty for no errors by scene.

    Raises:
        DeuxError: there is no frame, none has ground truth in range, or a prediction is not finite or not above 0 at a
            pixel with ground truth.
    """
    errors = DepthErrors(min_depth, max_depth, alone=True)
    baselines = _Baselines(min_depth, max_depth)
    device = device_of(model)
    images, farthest = 0, 0.0
    of_frames: list[dict[str, float]] = []
    for batch in batches:
        if batch.ground_truth is None:
            raise DeuxError("evaluation needs ground truth, and these frames were loaded without it.")
        truth = batch.ground_truth.cpu()
        predicted = model.predict(batch.image.to(device), batch.sparse_depth.to(device), batch.intrinsics.to(device))
        predicted = predicted.float().cpu()
        _check_predictions(invalid_pixels(predicted, truth, min_depth, max_depth), images)
        errors.update(predicted, truth)
        if scenes:
            of_frames += _frame_errors(predicted, truth, min_depth, max_depth)
        baselines.update(batch.sparse_depth.cpu(), truth)
        images, farthest = images + len(truth), max(farthest, float(truth.max()))
        if progress is not None:
            progress(len(truth))
    judged = int(errors.images.item())
    if judged == 0:
        lacking = f"none of the {counted(images, 'test frame')} has ground truth"
        if farthest == 0.0:
            raise DeuxError(f"{lacking}: where there are maps of it, they hold 0, which stands for no value.")
        raise DeuxError(
            f"{lacking} between {min_depth} and {max_depth} m, the range that is evaluated: it goes up to "
            f"{farthest:.4g} m, and camera.min_depth and camera.max_depth set the range."
        )
    baseline, constant = baselines.compute()
    by_scene = _by_scene(scenes, of_frames, baselines.of_frames)
    without_points = len(baselines.without_points)
    return Evaluation(_means(errors), baseline, constant, images, images - judged, without_points, by_scene)


class _Baselines:
    """The errors of what needs no model: the interpolated points, and their median; arguments as of `evaluate`."""

    def __init__(self, min_depth: float, max_depth: float) -> None:
        self.interpolated, self.constant = (DepthErrors(min_depth, max_depth, alone=True) for _ in range(2))
        self.without_points: dict[int, Tensor] = {}  # the ground truth of these frames, H x W, by the frame's number
        self._medians: list[float] = []
        self._range = min_depth, max_depth
        self._interpolated: dict[int, dict[str, float]] = {}
        self._seen = 0

    @property
    def of_frames(self) -> list[dict[str, float]]:
        """The interpolation's errors of each frame in order, once `compute` was called."""
        return [one for _, one in sorted(self._interpolated.items())]

    def update(self, sparse_depth: Tensor, truth: Tensor) -> None:
        """Count a batch: both N x 1 x H x W metres."""
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
        """The means of the interpolation and of the median, frames without points included."""
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
    """The errors of each image of a batch; NaN without ground truth in range."""
    errors = depth_errors(depth, truth, min_depth, max_depth)
    return [dict(zip(errors, values, strict=True)) for values in torch.stack(list(errors.values()), dim=1).tolist()]


def _by_scene(
    scenes: Sequence[str], metrics: Sequence[dict[str, float]], baseline: Sequence[dict[str, float]]
) -> list[SceneErrors]:
    """The means of frames of equal scenes; none where scenes are not told or there is no interpolation."""
    if not scenes or not baseline:
        return []
    of_scene: dict[str, list[int]] = {}
    for index, (scene, errors) in enumerate(zip(scenes, metrics, strict=True)):
        if not math.isnan(errors["mae"]):
            of_scene.setdefault(scene, []).append(index)

    def mean(errors: Sequence[dict[str, float]], frames: list[int]) -> dict[str, float]:
        return {name: round(sum(errors[frame][name] for frame in frames) / len(frames), 3) for name in METRICS}

    return [
        SceneErrors(scene, len(frames), mean(metrics, frames), mean(baseline, frames))
        for scene, frames in sorted(of_scene.items())
    ]


def _means(errors: DepthErrors) -> dict[str, float]:
    """The means by metric; NaN without any frame, of which torchmetrics would warn."""
    if not errors.update_called:
        return dict.fromkeys(METRICS, math.nan)
    return {name: value.item() for name, value in errors.compute().items()}


def _check_predictions(invalid: Tensor, before: int) -> None:
    """Raise DeuxError if a frame of a batch has invalid pixels; `before` is the number of frames before the batch."""
    for index, pixels in enumerate(invalid.tolist()):
        if pixels:
            raise DeuxError(
                f"the predicted depth of test frame {before + index} (the first is 0) is not finite or not above 0 at "
                f"{counted(pixels, 'pixel')} with ground truth, so it has no errors: evaluate another checkpoint, or "
                "mend the model."
            )
