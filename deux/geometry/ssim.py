"""Structural similarity of an image and its reconstructions (Wang et al., 2004)."""

from typing import Literal

import torch
from kornia.filters import filter2d_separable, get_box_kernel1d, get_gaussian_kernel1d
from torch import Tensor

from deux.errors import DeuxError
from deux.geometry.compiled_ssim import CONTRAST_CONSTANT, LUMINANCE_CONSTANT, compiled_ssim
from deux.geometry.tuned_forms import tuned_for_cpu

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

    `kornia.metrics.ssim` (without its `eps`) defines the values; on a GPU the same convolutions compute them. On a
    CPU compiled code is many times faster (docs/decisions/0012-kornia-geometry.md). It does not make the host wait for
    the device. Half-precision images are compared in float32, even with autocast.

    Args:
        image: N x ... x C x H x W.
        other: N x ... x C x H x W, broadcastable with `image`.
        window: window weights: a Gaussian of 1.5 pixels, or uniform (as in the published depth models).
        window_size: edge of the window in pixels, odd.
        border: mirror the images at their edges, or return only the pixels whose window lies inside.

    Returns:
        N x ... x C x H x W in [-1, 1], smaller by `window_size - 1` in both directions with `border="valid"`.

    Raises:
        DeuxError: the images are too small for the window.

    Example:
        >>> image = torch.rand(1, 3, 8, 8)
        >>> ssim(image, image).mean().item()
        1.0
    """
    height, width = image.shape[-2:]
    largest = 2 * min(height, width) - 1 if border == "reflect" else min(height, width)
    if window_size > largest:
        raise DeuxError(
            f"an SSIM window of {window_size} pixels is too large for images of {width} x {height}: "
            f"the maximum is {largest}."
        )
    dtype = torch.promote_types(torch.promote_types(image.dtype, other.dtype), torch.float32)
    compare = _by_rows if tuned_for_cpu(image) else _by_kornia
    with torch.autocast(image.device.type, enabled=False):
        return compare(image.to(dtype), other.to(dtype), window, window_size, border)


def wholly_visible(visible: Tensor, window_size: int = 3) -> Tensor:
    """Find the pixels whose whole SSIM window is visible.

    Args:
        visible: ... x H x W bool.
        window_size: edge of the window in pixels, odd.

    Returns:
        ... x H x W bool; pixels outside of the image count as visible, since the image is mirrored.
    """
    for axis in (-2, -1):
        whole = visible.clone()
        for shift in range(1, min(window_size // 2 + 1, visible.shape[axis])):
            length = visible.shape[axis] - shift
            whole.narrow(axis, shift, length).logical_and_(visible.narrow(axis, 0, length))
            whole.narrow(axis, 0, length).logical_and_(visible.narrow(axis, shift, length))
        visible = whole
    return visible


def _by_kornia(image: Tensor, other: Tensor, window: Window, size: int, border: Border) -> Tensor:
    """SSIM with convolutions of `kornia.filters`.

    `kornia.metrics.ssim` only supports a Gaussian window, and copies its width from the host at each call.
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

    def windowed(x: Tensor) -> Tensor:
        return filter2d_separable(x, kernel, kernel, padding=padding)

    # Eq. 13 of Wang et al.
    mean, other_mean = windowed(image), windowed(other)
    product = mean * other_mean
    squares = mean * mean + other_mean * other_mean
    covariance = windowed(image * other) - product
    variances = windowed(image * image + other * other) - squares
    similarity = (2.0 * product + LUMINANCE_CONSTANT) * (2.0 * covariance + CONTRAST_CONSTANT)
    similarity = similarity / ((squares + LUMINANCE_CONSTANT) * (variances + CONTRAST_CONSTANT))
    return similarity.unflatten(0, batch)


def _by_rows(image: Tensor, other: Tensor, window: Window, size: int, border: Border) -> Tensor:
    """SSIM with code compiled for CPUs."""
    if window == "box":
        weights = [1.0 / size] * size
    else:
        weights = get_gaussian_kernel1d(size, GAUSSIAN_SIGMA, dtype=torch.float64)[0].tolist()
    return compiled_ssim(image, other, weights, margin=size // 2 if border == "reflect" else 0)
