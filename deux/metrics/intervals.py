"""A mean and how sure it is."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats


class Estimate(NamedTuple):
    """A mean with its 95 % interval, mean - half_width to mean + half_width.

    Args:
        mean: of the sample; NaN if it is empty.
        half_width: NaN for fewer than two values, which say nothing of their spread.
    """

    mean: float
    half_width: float


def estimate(sample: Sequence[float]) -> Estimate:
    """The mean of independent values and Student's t interval, half width t(0.975, n - 1) s / sqrt(n)."""
    values = np.asarray(sample, float)
    if len(values) < 2:
        return Estimate(float(values[0]) if len(values) else np.nan, np.nan)
    half_width = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return Estimate(float(values.mean()), float(half_width))
