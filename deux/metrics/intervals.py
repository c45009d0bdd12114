"""The mean of a sample with its confidence interval."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit  # scipy.stats takes a second to import


class Estimate(NamedTuple):
    """Mean of a sample with its 95 % confidence interval, mean - half_width to mean + half_width.

    Args:
        mean: the sample mean; NaN for an empty sample.
        half_width: half width of the interval; NaN for fewer than two values or values that are not finite.
    """

    mean: float
    half_width: float = np.nan


def estimate(sample: Sequence[float]) -> Estimate:
    """Mean of independent values with Student's t interval, half width t(0.975, n - 1) s / sqrt(n).

    Example:
        >>> result = estimate([1.0, 2.0, 3.0])
        >>> result.mean, round(result.half_width, 3)
        (2.0, 2.484)
    """
    values = np.asarray(sample, float)
    if not len(values):
        return Estimate(np.nan)
    mean = float(values.mean())
    if len(values) < 2 or not np.isfinite(values).all():
        return Estimate(mean)
    half_width = stdtrit(len(values) - 1, 0.975) * values.std(ddof=1) / np.sqrt(len(values))
    return Estimate(mean, float(half_width))
