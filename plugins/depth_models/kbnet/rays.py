"""Viewing rays of the pixels at each level of the encoder."""

import torch
from torch import Tensor

Scale = tuple[float, float]


def camera_rays(intrinsics: Tensor, size: tuple[int, int], scale: Scale) -> Tensor:
    """The rays K_l^-1 [u v 1] of every pixel of a level; multiplied by the depth they are points in camera axes.

    K_l is K with its rows scaled to the level. As in the published network, all levels below the full size use the
    scale of the first halving, so that the rays are geometrically correct only at the full and at half the size.
    The inverse is explicit, for a camera matrix [[fx, s, cx], [0, fy, cy], [0, 0, 1]].

    Args:
        intrinsics: N x 3 x 3, of the full size.
        size: (H_l, W_l) of the level.
        scale: factors (y, x) of the rows of K: 1 at the full size, (H_1 / H_0, W_1 / W_0) at levels 1, 2 and 3.

    Returns:
        N x 3 x H_l x W_l float32, channels last in memory.
    """
    (height, width), (scale_y, scale_x) = size, scale
    k = intrinsics.float()[:, :, :, None, None]
    u = torch.arange(width, device=k.device, dtype=torch.float32)[None, None, :]
    v = torch.arange(height, device=k.device, dtype=torch.float32)[None, :, None]
    y = (v - scale_y * k[:, 1, 2]) / (scale_y * k[:, 1, 1])
    x = (u - scale_x * k[:, 0, 2] - scale_x * k[:, 0, 1] * y) / (scale_x * k[:, 0, 0])
    return torch.stack([x, y.expand_as(x), torch.ones_like(x)], dim=-1).permute(0, 3, 1, 2)
