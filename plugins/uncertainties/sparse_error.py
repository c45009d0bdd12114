"""Uncertainty by the error of the prediction at the sparse points, the only measured depth."""

import torch
from torch import Tensor

from deux.contracts import Uncertainty, View

PRIOR_WEIGHT = 0.01
"""Weight of the frame's mean error, relative to a point at distance 0."""


class SparseError(Uncertainty):
    """The weighted mean error of the prediction at nearby sparse points, in metres.

    The weight of a point d pixels away is exp(-d^2 / (2 s^2)), where s is half the mean distance between the frame's
    points, so that the nearest points dominate. Although the points are the model's input, its errors at the points
    indicate its errors between them, because predictions are smooth. NaN for a frame without points.

    Args:
        relative: whether to divide each point's error by its depth. Errors in metres grow with the distance; relative
            errors do not.
    """

    needs_sources = False

    def __init__(self, relative: bool = False) -> None:
        self._relative = relative

    def __call__(self, view: View) -> Tensor:
        """N x H x W metres, or fractions of the depth if `relative`."""
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
    """Gaussian filter matrices: exp(-d^2 / (2 sigma^2)) for pixels d apart, 0 beyond 3 sigma.

    With matrices each frame can have a different sigma that the host need not know.

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
