"""Compiled structural similarity and its gradient for CPUs, in one row-wise pass over each image."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
from torch import Tensor

from deux.compilation import compiled

LUMINANCE_CONSTANT = 0.01**2
CONTRAST_CONSTANT = 0.03**2


def compiled_ssim(image: Tensor, other: Tensor, weights: list[float], margin: int) -> Tensor:
    """Structural similarity at each pixel; once differentiable with respect to both images.

    Args:
        image: ... x H x W float32 or float64, on the CPU.
        other: ... x H x W of the same dtype, broadcastable with `image`.
        weights: k weights of the separable window, symmetric with a sum of 1.
        margin: mirror padding at each edge in pixels, smaller than the image: k // 2 preserves the size, 0 returns only
            the pixels whose window lies inside.

    Returns:
        ... x (H + 2 margin - k + 1) x (W + 2 margin - k + 1).
    """
    image, other = torch.broadcast_tensors(image, other)
    return _Similarity.apply(image, other, weights, margin)


class _Similarity(torch.autograd.Function):
    """Autograd function of `compiled_ssim`; the planes are independent and computed in parallel."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, other: Tensor, weights: list[float], margin: int) -> Tensor:
        ctx.save_for_backward(image, other)
        ctx.weights, ctx.margin = weights, margin
        shrinkage = len(weights) - 1 - 2 * margin
        size = [length - shrinkage for length in image.shape[-2:]]
        similarity = image.new_empty((*image.shape[:-2], *size))
        _for_each_plane(_similarity_of_planes, weights, margin, image, other, similarity)
        return similarity

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, Tensor | None, None, None]:
        image, other = ctx.saved_tensors
        results: list[Tensor | None] = [None, None]
        # SSIM is symmetric: the gradient of the first image is that of the second with both exchanged.
        for i, (fixed, moving) in enumerate(((other, image), (image, other))):
            if ctx.needs_input_grad[i]:
                results[i] = torch.empty_like(moving, memory_format=torch.contiguous_format)
                _for_each_plane(_gradient_of_planes, ctx.weights, ctx.margin, fixed, moving, gradients[0], results[i])
        return results[0], results[1], None, None


def _for_each_plane(kernel: Callable[..., None], weights: list[float], margin: int, *tensors: Tensor | None) -> None:
    """Call a kernel with the planes of ... x H x W tensors, in half as many threads as torch uses.

    Torch's own threads keep their cores busy for a while after each operation: with two cores, two threads take twice
    as long as one. The last tensor is the output and must be contiguous.
    """
    arrays = [x.detach().reshape(-1, *x.shape[-2:]).contiguous().numpy() for x in tensors if x is not None]
    window = np.array(weights, arrays[0].dtype)
    parts = min(torch.get_num_threads() // 2, len(arrays[0]))
    if parts <= 1:
        kernel(window, margin, *arrays)
        return
    chunks = [np.array_split(array, parts) for array in arrays]
    with ThreadPoolExecutor(parts) as threads:
        for _ in threads.map(lambda chunk: kernel(window, margin, *chunk), zip(*chunks, strict=True)):
            pass


@compiled(nogil=True, error_model="numpy")
def _mirrored_indices(length: int, margin: int) -> np.ndarray:
    """Source index of each row of an image that is mirrored at its edges without repeating them."""
    indices = np.abs(np.arange(-margin, length + margin))
    return np.where(indices < length, indices, 2 * (length - 1) - indices)


@compiled(nogil=True, error_model="numpy")
def _means_of_row(
    window: np.ndarray,
    margin: int,
    image: np.ndarray,
    other: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    sums: np.ndarray,
    means: np.ndarray,
) -> None:
    """Windowed means of image, other, image^2 + other^2 and image * other in one row.

    Args:
        window: k weights.
        margin: mirrored columns at each edge.
        image: H x W.
        other: H x W.
        rows: the k rows of the window.
        columns: W + 2 margin indices, `_mirrored_indices`.
        sums: 4 x (W + 2 margin), a buffer.
        means: 4 x (W + 2 margin - k + 1), the output.
    """
    width = image.shape[1]
    sums[:] = 0.0
    # Slices instead of index sums, which might be negative and would prevent vectorisation.
    centre = sums[:, margin : margin + width]
    for i in range(len(window)):
        weight, image_row, other_row = window[i], image[rows[i]], other[rows[i]]
        for x in range(width):
            a, b = weight * image_row[x], weight * other_row[x]
            centre[0, x] += a
            centre[1, x] += b
            centre[2, x] += a * image_row[x] + b * other_row[x]
            centre[3, x] += a * other_row[x]
    for q in range(4):
        for x in range(margin):
            sums[q, x] = centre[q, columns[x]]
            sums[q, margin + width + x] = centre[q, columns[margin + width + x]]
        means[q] = 0.0
        for j in range(len(window)):
            weight, shifted, mean = window[j], sums[q, j : j + means.shape[1]], means[q]
            for x in range(len(mean)):
                mean[x] += weight * shifted[x]


@compiled(nogil=True, error_model="numpy")
def _similarity_of_planes(
    window: np.ndarray, margin: int, images: np.ndarray, others: np.ndarray, similarities: np.ndarray
) -> None:
    """Eq. 13 of Wang et al. for n x H x W images; writes n x H' x W' values to `similarities`."""
    planes, height, width = images.shape
    rows, columns = _mirrored_indices(height, margin), _mirrored_indices(width, margin)
    sums = np.empty((4, width + 2 * margin), images.dtype)
    means = np.empty((4, similarities.shape[2]), images.dtype)
    c1, c2, two = images.dtype.type(LUMINANCE_CONSTANT), images.dtype.type(CONTRAST_CONSTANT), images.dtype.type(2.0)
    for n in range(planes):
        for y in range(similarities.shape[1]):
            _means_of_row(window, margin, images[n], others[n], rows[y : y + len(window)], columns, sums, means)
            for x in range(similarities.shape[2]):
                product = means[0, x] * means[1, x]
                squares = means[0, x] * means[0, x] + means[1, x] * means[1, x]
                numerator = (two * product + c1) * (two * (means[3, x] - product) + c2)
                similarities[n, y, x] = numerator / ((squares + c1) * (means[2, x] - squares + c2))


@compiled(nogil=True, error_model="numpy")
def _gradient_of_planes(
    window: np.ndarray, margin: int, images: np.ndarray, others: np.ndarray, gradients: np.ndarray, results: np.ndarray
) -> None:
    """Gradient with respect to `others`, n x H x W, from n x H' x W' gradients of the similarities.

    With the means m_a and m_b and the factors S = p q / (s t) of Eq. 13:
    dS/dm_b = 2 m_a (q - p) / (s t) - 2 m_b S (1 / s - 1 / t), dS/d mean(a b) = 2 p / (s t),
    dS/d mean(a^2 + b^2) = -S / t. Each is distributed over its window; the last two are multiplied by a and 2 b.
    """
    planes, height, width = images.shape
    rows, columns = _mirrored_indices(height, margin), _mirrored_indices(width, margin)
    sums = np.empty((4, width + 2 * margin), images.dtype)
    means = np.empty((4, gradients.shape[2]), images.dtype)
    slopes = np.empty((3, gradients.shape[2]), images.dtype)
    spread = np.empty((3, height, width), images.dtype)
    c1, c2, two = images.dtype.type(LUMINANCE_CONSTANT), images.dtype.type(CONTRAST_CONSTANT), images.dtype.type(2.0)
    for n in range(planes):
        spread[:] = 0.0
        for y in range(gradients.shape[1]):
            window_rows = rows[y : y + len(window)]
            _means_of_row(window, margin, images[n], others[n], window_rows, columns, sums, means)
            for x in range(gradients.shape[2]):
                a, b = means[0, x], means[1, x]
                squares = a * a + b * b
                p, q = two * a * b + c1, two * (means[3, x] - a * b) + c2
                s, t = squares + c1, means[2, x] - squares + c2
                scale = two * gradients[n, y, x] / (s * t)
                similarity = p * q / (s * t)
                slopes[0, x] = scale * (a * (q - p) - b * similarity * (t - s))
                slopes[1, x] = scale * p
                slopes[2, x] = -scale * similarity * s
            _spread_row(window, margin, slopes, window_rows, columns, sums, spread)
        for y in range(height):
            for x in range(width):
                results[n, y, x] = (
                    spread[0, y, x] + images[n, y, x] * spread[1, y, x] + others[n, y, x] * spread[2, y, x]
                )


@compiled(nogil=True, error_model="numpy")
def _spread_row(
    window: np.ndarray,
    margin: int,
    slopes: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    sums: np.ndarray,
    spread: np.ndarray,
) -> None:
    """Add the gradients of a row of means to the pixels of their windows: the transpose of `_means_of_row`."""
    width = spread.shape[2]
    for q in range(3):
        sums[q] = 0.0
        slope, centre = slopes[q], sums[q, margin : margin + width]
        for j in range(len(window)):
            weight, shifted = window[j], sums[q, j : j + len(slope)]
            for x in range(len(slope)):
                shifted[x] += weight * slope[x]
        for x in range(margin):
            centre[columns[x]] += sums[q, x]
            centre[columns[margin + width + x]] += sums[q, margin + width + x]
        for i in range(len(window)):
            weight, row = window[i], spread[q, rows[i]]
            for x in range(width):
                row[x] += weight * centre[x]
