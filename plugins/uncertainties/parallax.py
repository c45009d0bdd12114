"""The photometric residual in metres: normalised by how much depth matters to the reconstruction."""

import torch
from torch import Tensor
from torch.nn import functional

from deux.contracts import Uncertainty, View
from deux.geometry.reprojection import reproject

STEP = 0.05
"""Relative change of depth over which the reconstruction's derivative is taken."""

IMAGE_NOISE = 0.01
"""What the reconstruction of a perfect depth misses by, in units of the image: it is interpolated."""

PRIOR = 0.3
"""Standard deviation of the relative error that depth is expected to have before the images are looked at."""

WINDOW = 5
"""Pixels that share one correction: edge of a square."""

SMOOTHING = 9
"""Pixels over which the corrections' sizes are averaged in the end: one by itself is noisy."""


class ParallaxCorrection(Uncertainty):
    """The correction of the depth that the source frames ask for, in metres.

    It is one Gauss-Newton step (Lucas and Kanade, 1981) for a relative change rho of the depth in a window: with
    r = I - I_rebuilt and J = d I_rebuilt / d rho,

        rho = mean J r / (mean J^2 + (image noise / prior)^2),

    means over the window, sums over the source frames. Motion, texture and distance enter r and J alike, and so fall
    out. NaN where they make J too small for the images to say more than the prior does: on walls without texture, far
    away, and everywhere if the camera only turned.
    """

    def __call__(self, view: View) -> Tensor:
        """N x H x W metres, NaN where the images say nothing."""
        (nearer, nearer_seen), (farther, farther_seen) = (
            _rebuilt(view, view.depth * (1.0 + step)) for step in (-STEP, STEP)
        )
        counted = view.visible & nearer_seen & farther_seen
        slope = torch.where(counted, (farther - nearer) / (2.0 * STEP), 0.0)
        residual = torch.where(counted, view.image[:, None] - view.rebuilt, 0.0)
        # Means over the channels, sums over the source frames: two frames know more than one.
        product = _mean((slope * residual).mean(2).sum(1, keepdim=True), WINDOW)
        information = _mean(slope.square().mean(2).sum(1, keepdim=True), WINDOW)
        needed = (IMAGE_NOISE / PRIOR) ** 2
        correction = (product / (information + needed)).abs().clamp(max=1.0) * view.depth
        return torch.where(information > needed, _mean(correction, SMOOTHING), torch.nan)[:, 0]


def _rebuilt(view: View, depth: Tensor) -> tuple[Tensor, Tensor]:
    """The frames rebuilt from their sources if the depth were another one, and where they are visible."""
    return reproject(view.sources, depth, view.intrinsics, view.source_from_target)


def _mean(x: Tensor, size: int) -> Tensor:
    return functional.avg_pool2d(functional.pad(x, [size // 2] * 4, mode="replicate"), size, stride=1)
