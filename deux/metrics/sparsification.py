"""Sparsification curves and AUSE: the error after removing the most uncertain pixels (Ilg et al., 2018)."""

import numpy as np

REMOVED = np.linspace(0.0, 0.95, 20)
"""Fractions of removed pixels at which the curves are evaluated."""


def sparsification_curve(error: np.ndarray, uncertainty: np.ndarray) -> np.ndarray:
    """Mean error of the remaining pixels for each fraction of removed pixels.

    Args:
        error: N values.
        uncertainty: N values; pixels are removed in descending order. Passing the error itself gives the oracle curve,
            a lower bound for all others.

    Returns:
        A value for each fraction in `REMOVED`; at least one pixel always remains.

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
    """Area under the sparsification error (AUSE): the area between a curve and the oracle curve.

    It is normalised by the mean error of all pixels, and is 0 if the uncertainty orders the pixels like their errors.

    Args:
        curve: the sparsification curve of an uncertainty.
        oracle: the sparsification curve of the error itself.

    Example:
        >>> error = np.linspace(0.0, 1.0, 1001)
        >>> ause(sparsification_curve(error, error), sparsification_curve(error, error))
        0.0
    """
    return float(np.trapezoid(curve - oracle, REMOVED) / oracle[0])
