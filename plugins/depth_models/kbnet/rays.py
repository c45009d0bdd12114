"""Viewing rays of the pixels at each level of the encoder."""

import torch
from torch import Tensor


def camera_rays(intrinsics: Tensor, size: tuple[int, int], finer_size: tuple[int, int]) -> Tensor:
    """K_l^-1 [u v 1] of every pixel of a level: times the depth it is the point in camera axes.

    K_l is K with its rows scaled by the ratio of this level's size to that of the level before it. That is exact at
    the full and at half the size. Further down K should be scaled by the ratio to the full size, but the published
    network starts from the full K at each level, and its weights were trained with the rays that this gives.
    The inverse is written out, for a camera matrix [[fx, s, cx], [0, fy, cy], [0, 0, 1]].

    Args:
        intrinsics: N x 3 x 3, of the full size.
        size: (H_l, W_l) of the level.
        finer_size: size of the level before it; at the first level its own.

    Returns:
        N x 3 x H_l x W_l float32, channels last in memory.
    """
    height, width = size
    scale_y, scale_x = height / finer_size[0], width / finer_size[1]
    k = intrinsics.float()[:, :, :, None, None]
    u = torch.arange(width, device=k.device, dtype=torch.float32)[None, None, :]
    v = torch.arange(height, device=k.device, dtype=torch.float32)[None, :, None]
    y = (v - scale_y * k[:, 1, 2]) / (scale_y * k[:, 1, 1])
    x = (u - scale_x * k[:, 0, 2] - scale_x * k[:, 0, 1] * y) / (scale_x * k[:, 0, 0])
    return torch.stack([x, y.expand_as(x), torch.ones_like(x)], dim=-1).permute(0, 3, 1, 2)
