"""Pooling of sparse depth in windows."""

from torch import Tensor

from deux.errors import DeuxError
from deux.geometry.sliding_max import sliding_max

BEYOND_ANY_DEPTH = 999.0


def check_windows(option: str, windows: tuple[int, ...]) -> None:
    """Raise DeuxError unless the side of every window is an odd number of pixels."""
    for window in windows:
        if window < 1 or window % 2 == 0:
            raise DeuxError(f"{option} contains the window {window}: windows must be odd numbers of pixels.")


def sliding_min_of_points(sparse_depth: Tensor, window: int) -> Tensor:
    """Depth of the nearest sparse point in the window around each pixel; 0 if the window has no point.

    Args:
        sparse_depth: N x 1 x H x W metres, 0 = none.
        window: side of the window, odd.
    """
    points = sparse_depth.masked_fill(sparse_depth == 0, BEYOND_ANY_DEPTH)
    nearest = -sliding_max(-points, window)
    return nearest.masked_fill(nearest == BEYOND_ANY_DEPTH, 0.0)
