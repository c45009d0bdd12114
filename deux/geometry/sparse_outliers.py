"""Outlier removal for sparse depth points at occlusion boundaries."""

import torch
from torch import Tensor

from deux.geometry.sliding_max import sliding_max


def remove_outliers(sparse_depth: Tensor, kernel_size: int = 7, threshold: float = 1.5) -> Tensor:
    """Find the sparse points that are not much farther away than the nearest point in their window.

    A point is removed if a point in its window is nearer to the camera by more than the threshold, as in the published
    depth models: such pairs usually lie on both sides of an occlusion boundary.

    Args:
        sparse_depth: N x 1 x H x W metres, 0 = none.
        kernel_size: edge of the square window in pixels, odd.
        threshold: metres.

    Returns:
        validity: N x 1 x H x W float32, 1 = inlier, 0 = no point or outlier.

    Example:
        >>> points = torch.tensor([[[[2.0, 0.0, 5.0, 3.0]]]])  # 5 m is occluded by the surface at 2 m
        >>> remove_outliers(points).tolist()
        [[[[1.0, 0.0, 0.0, 1.0]]]]
    """
    points = sparse_depth > 0
    # Pixels without a point are set to infinity, so that they are never the nearest.
    away = torch.where(points, -sparse_depth, -torch.inf)
    nearest = -sliding_max(away, kernel_size)
    return (points & (nearest >= sparse_depth - threshold)).to(torch.float32)
