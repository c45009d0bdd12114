"""Sparsification curves and AUSE: how the error falls when the least certain pixels are left out (Ilg et al., 2018)."""

import numpy as np

REMOVED = np.linspace(0.0, 0.95, 20)
"""The fractions of pixels left out at which the curves are evaluated."""


def sparsification_curve(error: np.ndarray, uncertainty: np.ndarray) -> np.ndarray:
    """The mean error of the pixels that remain, for each fraction that is left out.

    Args:
        error: N values.
        uncertainty: N values; the pixels with the largest are left out first. The error itself gives the oracle's
            curve, which no other falls below.

    Returns:
        A value for each of `REMOVED`; at least one pixel always remains.

    Example:
        >>> error = np.linspace(0.0, 1.0, 1001)
        >>> sparsification_curve(error, uncertainty=error)[[0, 10]].round(2).tolist()  # all pixels, half of them
        [0.5, 0.25]
    """
    ascending = error[np.argsort(uncertainty, kind="stable")]
    means = np.cumsum(ascending) / np.arange(1, len(ascending) + 1)
    remaining = np.maximum(1, np.round(len(ascending) * (1.0 - REMOVED)).astype(int))
    result: np.ndarray = means[remaining - 1]
    return result


def ause(curve: np.ndarray, oracle: np.ndarray) -> float:
    """Area under the sparsification error (AUSE): the area between a curve and the oracle's, over the whole error.

    It is 0 for an uncertainty that orders the pixels as their errors do; a random order has about the area between the
    whole error and the oracle's curve.

    Args:
        curve: a sparsification curve.
        oracle: that of the error itself.

    Example:
        >>> error = np.linspace(0.0, 1.0, 1001)
        >>> ause(sparsification_curve(error, error), sparsification_curve(error, error))
        0.0
    """
    return float(np.trapezoid(curve - oracle, REMOVED) / oracle[0])
