"""What the sparse points say: the one place where the sensor has measured what the model should have predicted."""

import math

import torch
from kornia.filters import gaussian_blur2d
from torch import Tensor

from deux.contracts import Uncertainty, View

PRIOR_WEIGHT = 0.01
"""Weight of the frame's mean error, in points at distance 0."""


class SparseError(Uncertainty):
    """How far the prediction is from the sparse points nearby, in metres.

    A pixel takes the mean of the points' errors with the weights exp(-d^2 / (2 s^2)) for a point d pixels away; s is
    half the mean distance between the frame's points, so that mostly the nearest ones count. The model was given
    these points, but it is smooth: where it fits badly at them it does so between them. NaN for a frame without
    points.
    """

    def __call__(self, view: View) -> Tensor:
        """N x H x W metres."""
        # One by one: the width of the weights is each frame's own.
        frames = zip(view.depth.split(1), view.sparse_depth.split(1), strict=True)
        return torch.cat([_error_nearby(depth, sparse_depth)[:, 0] for depth, sparse_depth in frames])


def _error_nearby(depth: Tensor, sparse_depth: Tensor) -> Tensor:
    """The weighted mean error of the points around each pixel of one frame; all 1 x 1 x H x W metres."""
    points = sparse_depth > 0
    error = torch.where(points, (depth - sparse_depth).abs(), 0.0)
    known = points.to(error.dtype)
    sigma = 0.5 / max(float(known.mean()), 1.0 / known.numel()) ** 0.5
    mean = error.sum() / known.sum()
    total, weight = _weighted_sum(error, sigma), _weighted_sum(known, sigma)
    return (total + PRIOR_WEIGHT * mean) / (weight + PRIOR_WEIGHT)


def _weighted_sum(x: Tensor, sigma: float) -> Tensor:
    """Sums over the neighbourhood of each pixel of N x 1 x H x W, with Gaussian weights that are 1 at distance 0."""
    reach = min(round(3.0 * sigma), *(side - 1 for side in x.shape[-2:]))
    # The filter's weights sum to 1; undone, they have their peak at 1.
    return 2.0 * math.pi * sigma**2 * gaussian_blur2d(x, 2 * reach + 1, (sigma, sigma), "constant")
