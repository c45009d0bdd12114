"""Sliding maximum over large windows."""

from torch import Tensor
from torch.nn import functional

from deux.geometry.tuned_forms import fuses_steps, tuned_for_cpu


def sliding_max(x: Tensor, window: int) -> Tensor:
    """Maximum over the window x window pixels around each pixel; pixels outside of the image are ignored.

    The maximum is computed along the rows, then along the columns, with 2 k instead of k^2 comparisons. On a CPU,
    one-dimensional pooling is used, which is vectorised there: together 80 times faster at 29 x 29 pixels. Other
    devices use two-dimensional pooling for rows and columns, which needs no transposed copies.

    Args:
        x: N x C x H x W.
        window: side of the window, odd.
    """
    if not fuses_steps():
        return functional.max_pool2d(x, window, stride=1, padding=window // 2)
    return (_by_rows if tuned_for_cpu(x) else _by_rectangles)(x, window)


def _by_rows(x: Tensor, window: int) -> Tensor:
    """Pooling in one dimension, twice."""
    for _ in range(2):
        pooled = functional.max_pool1d(x.flatten(0, 2).unsqueeze(1), window, stride=1, padding=window // 2)
        x = pooled.view(x.shape).transpose(2, 3)
    return x


def _by_rectangles(x: Tensor, window: int) -> Tensor:
    """Pooling in two dimensions, over a row and over a column."""
    margin = window // 2
    rows = functional.max_pool2d(x, (1, window), stride=1, padding=(0, margin))
    return functional.max_pool2d(rows, (window, 1), stride=1, padding=(margin, 0))
