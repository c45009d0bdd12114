"""Structural similarity of an image and its reconstructions (Wang et al., 2004)."""

from typing import Literal

import torch
import torch.nn.functional as F
from kornia.filters import get_gaussian_kernel1d
from torch import Tensor

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

    The Gaussian window with mirrored borders gives the values of `kornia.metrics.ssim`, about ten times faster
    where gradients are needed on a CPU: the window is applied as sums of shifted views rather than convolutions.

    Args:
        image: N x ... x C x H x W.
        other: N x ... x C x H x W, broadcastable with `image`; the mean of the smaller one is computed only once.
        window: weights of the neighbourhood: a Gaussian of 1.5 pixels, or equal (the published depth models).
        window_size: edge of the neighbourhood in pixels, odd.
        border: mirror the images at their edges, or return only the pixels whose neighbourhood is inside.

    Returns:
        N x ... x C x H x W in [-1, 1], smaller by `window_size - 1` in both directions with `border="valid"`.
    """
    if border == "reflect":
        image, other = _mirrored(image, window_size // 2), _mirrored(other, window_size // 2)
    weights = _weights(window, window_size)
    mean, other_mean = _windowed(image, weights), _windowed(other, weights)
    product = mean * other_mean
    squares = mean * mean + other_mean * other_mean
    covariance = _windowed(image * other, weights) - product
    variances = _windowed(image * image + other * other, weights) - squares
    similarity = (2.0 * product + LUMINANCE_CONSTANT) * (2.0 * covariance + CONTRAST_CONSTANT)
    return similarity / ((squares + LUMINANCE_CONSTANT) * (variances + CONTRAST_CONSTANT))


def wholly_visible(visible: Tensor, window_size: int = 3) -> Tensor:
    """Which pixels are visible together with their whole neighbourhood, as SSIM needs it to be meaningful.

    Args:
        visible: ... x H x W bool.
        window_size: edge of the neighbourhood in pixels, odd.

    Returns:
        ... x H x W bool; what lies beyond the image's edge counts as visible, for it is mirrored.
    """
    hidden = (~visible).flatten(0, -3).float()
    near_hidden = F.max_pool2d(hidden, window_size, stride=1, padding=window_size // 2)
    return (near_hidden == 0).view_as(visible)


def _weights(window: Window, size: int) -> list[float]:
    if window == "box":
        return [1.0 / size] * size
    return get_gaussian_kernel1d(size, GAUSSIAN_SIGMA, dtype=torch.float64)[0].tolist()


def _mirrored(image: Tensor, margin: int) -> Tensor:
    return F.pad(image.flatten(0, -4), [margin] * 4, mode="reflect").unflatten(0, image.shape[:-3])


def _windowed(image: Tensor, weights: list[float]) -> Tensor:
    """Weighted means over the square window, one axis after the other, where it fits inside the image."""
    for axis in (-2, -1):
        length = image.shape[axis] - len(weights) + 1
        total = image.narrow(axis, 0, length) * weights[0]
        for shift, weight in enumerate(weights[1:], start=1):
            total = torch.add(total, image.narrow(axis, shift, length), alpha=weight)
        image = total
    return image
