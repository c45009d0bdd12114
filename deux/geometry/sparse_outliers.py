"""Sparse depth points that contradict their neighbours: background seen past a foreground edge."""

import torch
from torch import Tensor

from deux.geometry.sliding_max import sliding_max


def remove_outliers(sparse_depth: Tensor, kernel_size: int = 7, threshold: float = 1.5) -> Tensor:
    """Find the sparse points that are not much farther than the nearest point around them.

    A point is dropped if some point in its window is nearer to the camera by more than the threshold, as in the
    published depth models: with few points such a pair usually straddles an occlusion.

    Args:
        sparse_depth: N x 1 x H x W metres, 0 = none.
        kernel_size: edge of the square window in pixels, odd.
        threshold: metres.

    Returns:
        validity: N x 1 x H x W float32, 1 = kept point, 0 = no point or dropped.

    Example:
        >>> points = torch.tensor([[[[2.0, 0.0, 5.0, 3.0]]]])  # 5 m is behind the edge of what is at 2 m
        >>> remove_outliers(points).tolist()
        [[[[1.0, 0.0, 0.0, 1.0]]]]
    """
    points = sparse_depth > 0
    # Pixels without a point must never be the nearest: they are pooled as infinitely far.
    away = torch.where(points, -sparse_depth, -torch.inf)
    nearest = -sliding_max(away, kernel_size)
    return (points & (nearest >= sparse_depth - threshold)).to(torch.float32)
