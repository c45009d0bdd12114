"""What the sparse points say: the one place where the sensor has measured what the model should have predicted."""

import torch
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

    Args:
        relative: whether each point's error is divided by its depth. In metres, a surface is the more uncertain the
            farther away it was seen; relative errors are those of the surface alone.
    """

    needs_sources = False

    def __init__(self, relative: bool = False) -> None:
        self._relative = relative

    def __call__(self, view: View) -> Tensor:
        """N x H x W metres; shares of the depth where `relative`."""
        points = view.sparse_depth[:, 0] > 0
        error = (view.depth - view.sparse_depth)[:, 0].abs()
        if self._relative:
            error = error / view.sparse_depth[:, 0]
        error = torch.where(points, error, 0.0)
        known = points.to(error.dtype)
        count = known.sum(dim=(1, 2), keepdim=True)
        sigma = 0.5 * (known[0].numel() / count.clamp(min=1.0)).sqrt()
        mean = error.sum(dim=(1, 2), keepdim=True) / count
        rows, columns = (_gaussian(size, sigma) for size in known.shape[1:])
        return (rows @ error @ columns + PRIOR_WEIGHT * mean) / (rows @ known @ columns + PRIOR_WEIGHT)


def _gaussian(size: int, sigma: Tensor) -> Tensor:
    """Weights of the pixels of a line for each pixel of it: exp(-d^2 / (2 sigma^2)) up to 3 sigma away, else 0.

    As matrices, so that each frame has its own width without the host's knowing it.

    Args:
        size: number of pixels.
        sigma: N x 1 x 1, pixels.

    Returns:
        N x size x size.
    """
    places = torch.arange(size, dtype=sigma.dtype, device=sigma.device)
    distance = (places[:, None] - places).abs()
    weights = torch.exp(-0.5 * (distance / sigma).square())
    return torch.where(distance <= (3.0 * sigma).round(), weights, 0.0)
