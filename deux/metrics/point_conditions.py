"""The errors of a depth model with other sparse points than the stored ones: how many, where, and how wrong."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from deux.collection.point_patterns import Pattern
from deux.contracts import Batch, DepthModel, Reader
from deux.data.augmentation import DrawPoints
from deux.data.triplets import SampleSettings, TripletDataset, collate
from deux.metrics.model_errors import Evaluation, evaluate


@dataclass(frozen=True)
class PointCondition:
    """The sparse points of test frames, drawn from their ground truth.

    Args:
        pattern: where they lie.
        density: their number as a fraction of the pixels.
        noise: standard deviation of their depth relative to it.
        outliers: fraction of them that is badly wrong (`deux.collection.point_patterns.disturb`).
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
    """The errors of a model and of interpolation on the test split of a dataset, with points drawn anew.

    Each frame's points follow from its place in the split, so that every model is given the same.

    Args:
        condition: what points.
        model: the depth model.
        reader: of frames with ground truth.
        min_depth: as of `evaluate`.
        max_depth: as of `evaluate`.
        frames: number of frames, spread evenly over the split; None for all.

    Raises:
        DeuxError: as `evaluate`, or the frames have no ground truth.
    """
    density, noise, outliers = ((value, value) for value in (condition.density, condition.noise, condition.outliers))
    draw = DrawPoints(density, (condition.pattern,), noise, outliers)
    settings = SampleSettings(training=True, ground_truth=True, sources="unread", poses=False, augmentation=(draw,))
    data = TripletDataset([reader], "test", settings)
    return evaluate(model, _single_frames(data, _spread(len(data), frames)), min_depth, max_depth)


def _single_frames(data: TripletDataset, places: Sequence[int]) -> Iterator[Batch]:
    """Batches of one frame, since those of a recording may differ in size."""
    return (collate([data[place, place]]) for place in places)


def _spread(size: int, count: int | None) -> list[int]:
    """`count` places, evenly over so many."""
    wanted = min(size, count or size)
    return [number * size // wanted for number in range(wanted)]
