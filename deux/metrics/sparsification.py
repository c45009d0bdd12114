"""Sparsification: how fast the error falls when the pixels that are thought the least certain are left out."""

import numpy as np

REMOVED = np.linspace(0.0, 0.95, 20)
"""The shares of pixels that are left out, at which the curves are evaluated."""


def sparsification_curve(error: np.ndarray, uncertainty: np.ndarray) -> np.ndarray:
    """The mean error of the pixels that remain (Ilg et al., 2018).

    Args:
        error: N values.
        uncertainty: N values; those with the largest are left out first. The error itself gives the best curve there
            is, the oracle's.

    Returns:
        A value for each of `REMOVED`; at least one pixel always remains.
    """
    ascending = error[np.argsort(uncertainty, kind="stable")]
    means = np.cumsum(ascending) / np.arange(1, len(ascending) + 1)
    remaining = np.maximum(1, np.round(len(ascending) * (1.0 - REMOVED)).astype(int))
    result: np.ndarray = means[remaining - 1]
    return result


def ause(curve: np.ndarray, oracle: np.ndarray) -> float:
    """The area between a sparsification curve and the oracle's, as a share of the error with all pixels.

    0 orders the pixels as their errors do; an order by chance has about the area under 1 - oracle / all.
    """
    return float(np.trapezoid(curve - oracle, REMOVED) / oracle[0])
