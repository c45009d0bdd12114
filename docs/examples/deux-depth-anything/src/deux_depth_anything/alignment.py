"""Depth in metres from inverse depth of unknown scale and shift, by the sparse points measured in the image."""

import torch
from torch import Tensor

ITERATIONS = 10
"""Of the reweighted least squares; later ones change the fit by less than 1 %."""

LEAST_SCALE = 0.1
"""The scale stays above this part of the one that fits without a shift: a negative one would swap near and far."""

TYPICAL_DEPTH = 2.0
"""Median depth in metres of a frame without a single point."""

LEAST_SPREAD = 1e-10
"""Variance of r, as a part of its mean square, below which it is rounding and says nothing of the scale."""

EPSILON = 1e-6


def align(
    relative: Tensor, sparse_depth: Tensor, validity: Tensor, depth_range: tuple[float, float], metric: bool = False
) -> Tensor:
    """Fit scale s and shift t, frame by frame, such that s r + t is the inverse depth of the sparse points.

    They minimise the sum of w (s r + t - 1 / d)^2 over the points. The weights w = 1 / (1 + (e / c)^2) of the residuals
    e make it robust (Cauchy's estimator, c = 2.385 standard deviations, by the median of |e|), by iteratively
    reweighted least squares. With a single point, or where r is the same at all of them, t is 0. Nothing makes the host
    wait for the device.

    Args:
        relative: N x 1 x H x W, r: inverse depth up to scale and shift, 0 or more.
        sparse_depth: N x 1 x H x W metres, 0 = none.
        validity: N x 1 x H x W, 1 at the points that count.
        depth_range: nearest and farthest depth in metres; the result stays within.
        metric: whether r is in 1 / metres already, which decides in a frame without points.

    Returns:
        N x 1 x H x W float32 metres.
    """
    nearest, farthest = depth_range
    r = relative.float().flatten(1)
    counts = (validity > 0).flatten(1) & (sparse_depth > 0).flatten(1)
    target = torch.where(counts, 1.0 / sparse_depth.float().flatten(1).clamp(min=EPSILON), 0.0)
    scale, shift = _fit(r.detach(), target, counts.float())
    unseen = 1.0 if metric else 1.0 / (TYPICAL_DEPTH * r.detach().median(1, keepdim=True).values.clamp(min=EPSILON))
    found = counts.any(1, keepdim=True)
    inverse = torch.where(found, scale, unseen) * r + torch.where(found, shift, 0.0)
    return (1.0 / inverse.clamp(1.0 / farthest, 1.0 / nearest)).view_as(relative)


def _fit(r: Tensor, target: Tensor, counts: Tensor) -> tuple[Tensor, Tensor]:
    """Scale and shift, N x 1 each, of N x P values."""
    weight = counts
    for _ in range(ITERATIONS):
        scale, shift = _weighted_fit(r, target, weight)
        residual = (scale * r + shift - target).abs()
        width = 2.385 * 1.4826 * _median(residual, counts) + EPSILON
        weight = counts / (1.0 + (residual / width).square())
    return _weighted_fit(r, target, weight)


def _weighted_fit(r: Tensor, target: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted least squares: the fit without a shift, and what the centred values add to it."""
    total = weight.sum(1, keepdim=True).clamp(min=EPSILON)

    def mean(x: Tensor) -> Tensor:
        return (weight * x).sum(1, keepdim=True) / total

    alone = mean(r * target) / mean(r * r).clamp(min=EPSILON)
    centred = r - mean(r)
    variance = mean(centred.square()) + LEAST_SPREAD * mean(r * r)
    scale = alone + mean(centred * (target - alone * r)) / variance.clamp(min=EPSILON**2)
    scale = torch.maximum(scale, LEAST_SCALE * alone)
    return scale, mean(target - scale * r)


def _median(x: Tensor, counts: Tensor) -> Tensor:
    """Lower median of the values that count, N x 1."""
    ordered = torch.where(counts > 0, x, torch.inf).sort(1).values
    middle = ((counts.sum(1, keepdim=True) - 1) / 2).floor().clamp(min=0).long()
    median = ordered.gather(1, middle)
    return torch.where(median.isfinite(), median, 0.0)
