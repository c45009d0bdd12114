"""The measures of uncertainty by name, and what a whole frame's uncertainty is."""

from collections.abc import Callable, Mapping
from typing import Literal

import torch
from torch import Tensor

from deux.uncertainty.disagreement import flip, hidden_points
from deux.uncertainty.parallax import parallax
from deux.uncertainty.photometric import l1, ssim
from deux.uncertainty.sparse_error import sparse_error
from deux.uncertainty.view import View

Measure = Callable[[View], Tensor]
"""A view to N x H x W float32, not negative: the larger, the less certain; NaN where the measure cannot tell."""

MeasureName = Literal["l1", "ssim", "parallax", "flip", "hidden_points", "sparse_error"]
"""What `collect.uncertainty` may be."""

MEASURES: Mapping[MeasureName, Measure] = {
    "l1": l1,
    "ssim": ssim,
    "parallax": parallax,
    "flip": flip,
    "hidden_points": hidden_points,
    "sparse_error": sparse_error,
}
"""The paper's first, then those that were found to follow the true error better; docs/uncertainty.md compares them."""


def frame_uncertainty(uncertainty: Tensor) -> Tensor:
    """The uncertainty of a frame as one number, delta = 1 - exp(-mean) (Eq. 8).

    The paper averages over all pixels; here a pixel of which the measure says nothing is left out.

    Args:
        uncertainty: N x H x W, what a `Measure` returns.

    Returns:
        N float32 in [0, 1), NaN for a frame without any value.
    """
    return 1.0 - torch.exp(-uncertainty.flatten(1).nanmean(dim=1))
