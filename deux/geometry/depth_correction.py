"""Correction of predicted depth with sparse points, by interpolating the log-ratio of measured and predicted depth."""

import torch
from torch import Tensor

from deux.geometry.sparse_outliers import remove_outliers

_SCALES = (1.0, 0.5, 0.25)
"""Standard deviations of the Gaussians relative to the point spacing; the widest one fills gaps between the points.

On frames of unseen apartments, with a KBNet after 300 steps and one point in 100 pixels, the median relative error of
13.3 % becomes 11.0 % with the first alone and 7.5 % with all three; linear interpolation of the points has 4.1 %.
"""

_ACCEPTED = 0.5
"""Deviation of a point's log-ratio from its neighbourhood at which its weight is halved."""

_CONFIDENCE = 0.05
"""Weight of a log-ratio of 0, relative to a point at the pixel itself: far from all points the depth is unchanged."""


def correct_depth(depth: Tensor, sparse_depth: Tensor, spacing: float | Tensor | None = None) -> Tensor:
    """Multiply predicted depth by a smooth scale field that aligns it with the sparse points.

    The log-ratio r = log(measured / predicted) at the sparse points is interpolated over the image by normalised
    convolution (Knutsson and Westin, 1993) with a Gaussian g, and the result is

        d' = d exp((g * w r) / (g * w + c)),

    where the weight w is 0 at pixels without a point and c is small. This is repeated from coarse to fine, with the
    standard deviation of g being 1, 1/2 and 1/4 of the point spacing. Each field is estimated twice: first with w = 1
    at the inliers (`remove_outliers`), then with w = 1 / (1 + (e / 0.5)^2), where e is the residual of the first
    estimate. This reduces the influence of points at edges that are blurred in the prediction.

    Computed in float32 and separately for each frame, independent of the rest of the batch. It does not make the host
    wait for the device.

    Args:
        depth: N x 1 x H x W metres, above 0.
        sparse_depth: N x 1 x H x W metres, 0 = none.
        spacing: mean distance of neighbouring points in pixels, as a number or a 0-dimensional tensor; None for the
            `point_spacing` of each frame.

    Returns:
        N x 1 x H x W float32 metres; frames without points are unchanged.

    Example:
        >>> depth, points = torch.full((1, 1, 9, 9), 2.0), torch.zeros(1, 1, 9, 9)
        >>> points[..., 4, 4] = 3.0  # measured where 2 m were predicted
        >>> correct_depth(depth, points, spacing=3.0)[..., 4, 4].item() > 2.9
        True
    """
    depth, sparse_depth = depth.float(), sparse_depth.float()
    validity = remove_outliers(sparse_depth)
    frames = []
    for frame, points, valid in zip(depth[:, 0], sparse_depth[:, 0], validity[:, 0], strict=True):
        own_spacing = point_spacing(points) if spacing is None else spacing
        corrected = frame
        for scale in _SCALES:
            down, across = (_gaussian(size, scale * own_spacing, frame.device) for size in frame.shape)
            corrected = _correct_frame(corrected, points, valid, down, across)
        frames.append(corrected)
    return torch.stack(frames)[:, None]


def point_spacing(sparse_depth: Tensor) -> Tensor:
    """Mean distance in pixels of neighbouring points, 1 / sqrt(points per pixel), as a 0-dimensional float64 tensor.

    Args:
        sparse_depth: H x W metres, 0 = none.
    """
    return (sparse_depth.numel() / (sparse_depth > 0).sum().clamp(min=1).double()).sqrt()


def _correct_frame(depth: Tensor, sparse_depth: Tensor, validity: Tensor, down: Tensor, across: Tensor) -> Tensor:
    """Correct one frame, all H x W; batched matrix products could differ from these in the last bits."""
    ratio = torch.where(validity > 0, sparse_depth / depth, 1.0).log()
    first = _interpolate(ratio, validity, down, across)
    weight = validity / (1.0 + ((ratio - first) / _ACCEPTED).square())
    return depth * _interpolate(ratio, weight, down, across).exp()


def _interpolate(values: Tensor, weight: Tensor, down: Tensor, across: Tensor) -> Tensor:
    """Normalised convolution of H x W values with H x W weights."""
    return (down @ (weight * values) @ across) / (down @ weight @ across + _CONFIDENCE)


def _gaussian(size: int, deviation: float | Tensor, device: torch.device) -> Tensor:
    """Convolution along one axis as a size x size matrix, exp(-(i - j)^2 / (2 deviation^2))."""
    place = torch.arange(size, dtype=torch.float32, device=device)
    distance = (place[:, None] - place) / deviation
    return torch.exp(-0.5 * distance.square())
