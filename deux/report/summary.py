"""Mean and 95 % interval over the seeds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from deux.metrics.intervals import estimate


@dataclass(frozen=True)
class Summary:
    """One number of a table.

    Args:
        mean: over the seeds.
        interval: half the width of the 95 % interval of the mean; None with fewer than two seeds.
        seeds: those that the mean is over; empty for a number that no seed changes.
    """

    mean: float
    interval: float | None
    seeds: tuple[int, ...] = ()


def summary(values: Mapping[int, float]) -> Summary:
    """Mean of one value a seed, with Student's interval: t(0.975, n - 1) times s / sqrt(n).

    Example:
        >>> found = summary({0: 1.0, 1: 2.0, 2: 3.0})
        >>> found.mean, round(found.interval, 3)
        (2.0, 2.484)
    """
    mean, half_width = estimate(list(values.values()))
    return Summary(mean, None if math.isnan(half_width) else half_width, tuple(sorted(values)))
