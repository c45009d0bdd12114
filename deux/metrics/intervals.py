"""The mean of a sample with its confidence interval."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit  # of scipy.stats too, which takes a second to import


class Estimate(NamedTuple):
    """A mean with its 95 % confidence interval, mean - half_width to mean + half_width.

    Args:
        mean: of the sample; NaN if it is empty.
        half_width: NaN where there is no interval: for fewer than two values, or values that are not finite.
    """

    mean: float
    half_width: float = np.nan


def estimate(sample: Sequence[float]) -> Estimate:
    """The mean of independent values and Student's t interval, half width t(0.975, n - 1) s / sqrt(n).

    Example:
        >>> found = estimate([1.0, 2.0, 3.0])
        >>> found.mean, round(found.half_width, 3)
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
