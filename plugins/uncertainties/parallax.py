"""The photometric residual in metres, normalised by the derivative of the reconstruction with respect to depth."""

import torch
from torch import Tensor
from torch.nn import functional

from deux.contracts import Uncertainty, View
from deux.geometry.reprojection import reproject

STEP = 0.05
"""Relative change of depth for the finite difference of the reconstruction."""

IMAGE_NOISE = 0.01
"""Error of the reconstruction with perfect depth, in units of the image, because of interpolation."""

PRIOR = 0.3
"""Prior standard deviation of the relative error of depth."""

WINDOW = 5
"""Edge in pixels of the square window over which a correction is estimated."""

SMOOTHING = 9
"""Edge in pixels of the square window over which the noisy corrections are averaged."""


class ParallaxCorrection(Uncertainty):
    """The magnitude of the depth correction that minimises the photometric error, in metres.

    It is one Gauss-Newton step (Lucas and Kanade, 1981) for a relative change rho of the depth in a window: with
    r = I - I_rebuilt and J = d I_rebuilt / d rho,

        rho = mean J r / (mean J^2 + (image noise / prior)^2),

    with means over the window and sums over the source frames. Motion, texture and distance affect r and J equally and
    cancel out. NaN where J is so small that the images are less informative than the prior: on walls without texture,
    far away, and everywhere if the camera only rotated.
    """

    def __call__(self, view: View) -> Tensor:
        """N x H x W metres, NaN where the images are not informative."""
        (nearer, nearer_seen), (farther, farther_seen) = (
            _rebuilt(view, view.depth * (1.0 + step)) for step in (-STEP, STEP)
        )
        counted = view.visible & nearer_seen & farther_seen
        slope = torch.where(counted, (farther - nearer) / (2.0 * STEP), 0.0)
        residual = torch.where(counted, view.image[:, None] - view.rebuilt, 0.0)
        # Means over the channels, sums over the source frames: information adds up.
        product = _mean((slope * residual).mean(2).sum(1, keepdim=True), WINDOW)
        information = _mean(slope.square().mean(2).sum(1, keepdim=True), WINDOW)
        prior = (IMAGE_NOISE / PRIOR) ** 2
        correction = (product / (information + prior)).abs().clamp(max=1.0) * view.depth
        return torch.where(information > prior, _mean(correction, SMOOTHING), torch.nan)[:, 0]


def _rebuilt(view: View, depth: Tensor) -> tuple[Tensor, Tensor]:
    """The frames rebuilt from their source frames with another depth, and where they are visible."""
    return reproject(view.sources, depth, view.intrinsics, view.source_from_target)


def _mean(x: Tensor, size: int) -> Tensor:
    return functional.avg_pool2d(functional.pad(x, [size // 2] * 4, mode="replicate"), size, stride=1)
