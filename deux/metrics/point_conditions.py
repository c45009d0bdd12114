"""Errors of a depth model with sparse points of another density, distribution or noise than the stored ones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from deux.collection.point_patterns import Pattern
from deux.contracts import Batch, DepthModel, Reader
from deux.data.augmentation import DrawPoints
from deux.data.triplets import SampleSettings, TripletDataset, collate
from deux.metrics.model_errors import Evaluation, evaluate


@dataclass(frozen=True)
class PointCondition:
    """How sparse points are sampled from the ground truth of test frames.

    Args:
        pattern: spatial distribution of the points.
        density: number of points as a fraction of the pixels.
        noise: standard deviation of the relative depth error.
        outliers: fraction of outliers (`deux.collection.point_patterns.disturb`).
    """

    pattern: Pattern = "corners"
    density: float = 0.01
    noise: float = 0.0
    outliers: float = 0.0


def errors_under(
    condition: PointCondition,
    model: DepthModel,
    reader: Reader,
    min_depth: float = 0.1,
    max_depth: float = 10.0,
    frames: int | None = None,
) -> Evaluation:
    """Evaluate a model and the baselines on the test split of a dataset with newly sampled sparse points.

    The random seed of each frame's points is its index in the split, so that all models get the same points.

    Args:
        condition: how the points are sampled.
        model: the depth model.
        reader: reader of a dataset with ground truth.
        min_depth: see `evaluate`.
        max_depth: see `evaluate`.
        frames: number of frames, spread evenly over the split; None for all.

    Raises:
        DeuxError: see `evaluate`, or the frames have no ground truth.
    """
    density, noise, outliers = ((value, value) for value in (condition.density, condition.noise, condition.outliers))
    draw = DrawPoints(density, (condition.pattern,), noise, outliers)
    settings = SampleSettings(training=True, ground_truth=True, sources="unread", poses=False, augmentation=(draw,))
    data = TripletDataset([reader], "test", settings)
    return evaluate(model, _single_frames(data, _spread(len(data), frames)), min_depth, max_depth)


def _single_frames(data: TripletDataset, indices: Sequence[int]) -> Iterator[Batch]:
    """Batches of one frame, since the frames of a recording may differ in size."""
    return (collate([data[index, index]]) for index in indices)


def _spread(size: int, count: int | None) -> list[int]:
    """`count` indices, spread evenly over `size`."""
    count = min(size, count or size)
    return [number * size // count for number in range(count)]
