"""Structural similarity of an image and its reconstructions (Wang et al., 2004)."""

from collections.abc import Callable
from typing import Any, Literal

import torch
import torch.nn.functional as F
from kornia.filters import filter2d_separable, get_box_kernel1d, get_gaussian_kernel1d
from torch import Tensor

from deux.geometry.sliding_max import sliding_max
from deux.geometry.tuned_forms import tuned_for_cpu

LUMINANCE_CONSTANT = 0.01**2
CONTRAST_CONSTANT = 0.03**2
GAUSSIAN_SIGMA = 1.5

Window = Literal["gaussian", "box"]
Border = Literal["reflect", "valid"]


def ssim(
    image: Tensor,
    other: Tensor,
    window: Window = "gaussian",
    window_size: int = 3,
    border: Border = "reflect",
) -> Tensor:
    """Structural similarity at each pixel and channel, for images in [0, 1].

    `kornia.metrics.ssim` (without its `eps`) defines the values; on a GPU they come from the same convolutions. On a
    CPU they are computed several times faster from sums of shifted views (docs/decisions/0012-kornia-geometry.md).
    Nothing here makes the host wait for the device.
    Half-precision images are compared in float32, also in an enclosing autocast.

    Args:
        image: N x ... x C x H x W.
        other: N x ... x C x H x W, broadcastable with `image`.
        window: weights of the neighbourhood: a Gaussian of 1.5 pixels, or equal (the published depth models).
        window_size: edge of the neighbourhood in pixels, odd.
        border: mirror the images at their edges, or return only the pixels whose neighbourhood is inside.

    Returns:
        N x ... x C x H x W in [-1, 1], smaller by `window_size - 1` in both directions with `border="valid"`.
    """
    dtype = torch.promote_types(torch.promote_types(image.dtype, other.dtype), torch.float32)
    compare = _by_shifted_views if tuned_for_cpu(image) else _by_kornia
    with torch.autocast(image.device.type, enabled=False):
        return compare(image.to(dtype), other.to(dtype), window, window_size, border)


def wholly_visible(visible: Tensor, window_size: int = 3) -> Tensor:
    """Which pixels are visible together with their whole neighbourhood, as SSIM needs it to be meaningful.

    Args:
        visible: ... x H x W bool.
        window_size: edge of the neighbourhood in pixels, odd.

    Returns:
        ... x H x W bool; what lies beyond the image's edge counts as visible, for it is mirrored.
    """
    hidden = (~visible).flatten(0, -3).float()
    return (sliding_max(hidden[:, None], window_size) == 0).view_as(visible)


def _by_kornia(image: Tensor, other: Tensor, window: Window, size: int, border: Border) -> Tensor:
    """SSIM with the window as a convolution by `kornia.filters`.

    `kornia.metrics.ssim` does the same for a Gaussian window alone, and copies the window's width from the host at
    each call.
    """
    image, other = torch.broadcast_tensors(image, other)
    batch = image.shape[:-3]
    image, other = image.flatten(0, -4), other.flatten(0, -4)
    padding = "same" if border == "reflect" else "valid"
    if window == "box":
        kernel = get_box_kernel1d(size, device=image.device, dtype=image.dtype)
    else:
        offsets = torch.arange(size, device=image.device, dtype=image.dtype) - size // 2
        kernel = torch.softmax(-0.5 * (offsets / GAUSSIAN_SIGMA).square(), dim=0)[None]
    similarity = _similarity(image, other, lambda x: filter2d_separable(x, kernel, kernel, padding=padding))
    return similarity.unflatten(0, batch)


def _by_shifted_views(image: Tensor, other: Tensor, window: Window, size: int, border: Border) -> Tensor:
    """SSIM with the window as sums of shifted views; what is broadcast is averaged only once."""
    if border == "reflect":
        image, other = _mirrored(image, size // 2), _mirrored(other, size // 2)
    if window == "box":
        weights = [1.0 / size] * size
    else:
        weights = get_gaussian_kernel1d(size, GAUSSIAN_SIGMA, dtype=torch.float64)[0].tolist()
    return _similarity(image, other, lambda x: _WindowedMean.apply(x, weights))


def _similarity(image: Tensor, other: Tensor, windowed: Callable[[Tensor], Tensor]) -> Tensor:
    """Eq. 13 of Wang et al., from the weighted means over the window that `windowed` computes."""
    mean, other_mean = windowed(image), windowed(other)
    product = mean * other_mean
    squares = mean * mean + other_mean * other_mean
    covariance = windowed(image * other) - product
    variances = windowed(image * image + other * other) - squares
    similarity = (2.0 * product + LUMINANCE_CONSTANT) * (2.0 * covariance + CONTRAST_CONSTANT)
    return similarity / ((squares + LUMINANCE_CONSTANT) * (variances + CONTRAST_CONSTANT))


def _mirrored(image: Tensor, margin: int) -> Tensor:
    return F.pad(image.flatten(0, -4), [margin] * 4, mode="reflect").unflatten(0, image.shape[:-3])


class _WindowedMean(torch.autograd.Function):
    """Weighted means over the square window, one axis after the other, where it fits inside the image.

    The gradient is written out: each axis is one sum of shifted views in place, where automatic differentiation fills
    a new image with zeros for every view.
    """

    @staticmethod
    def forward(ctx: Any, image: Tensor, weights: list[float]) -> Tensor:
        """Means of ... x H x W by the k weights of each axis: ... x (H - k + 1) x (W - k + 1)."""
        ctx.weights = weights
        for axis in (-2, -1):
            length = image.shape[axis] - len(weights) + 1
            total = image.narrow(axis, 0, length) * weights[0]
            for shift, weight in enumerate(weights[1:], start=1):
                total.add_(image.narrow(axis, shift, length), alpha=weight)
            image = total
        return image

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        """The transposed sums: each gradient spreads over its window."""
        (gradient,) = gradients
        for axis in (-2, -1):
            shape = list(gradient.shape)
            length = shape[axis]
            shape[axis] += len(ctx.weights) - 1
            spread = gradient.new_zeros(shape)
            for shift, weight in enumerate(ctx.weights):
                spread.narrow(axis, shift, length).add_(gradient, alpha=weight)
            gradient = spread
        return gradient, None
