"""Photometric residual of a depth map (Eq. 8 of the paper)."""

from typing import Literal

import torch
from torch import Tensor

from deux.geometry.ssim import ssim, wholly_visible

Metric = Literal["l1", "ssim"]


def photometric_residual(image: Tensor, reconstructions: Tensor, visible: Tensor, metric: Metric = "l1") -> Tensor:
    """Mean reconstruction error at each pixel, over the channels and the source frames in which it is visible.

    Args:
        image: N x 3 x H x W in [0, 1], the target frame.
        reconstructions: N x S x 3 x H x W, the target frame reconstructed from each source frame.
        visible: N x S x 1 x H x W bool, the valid pixels of each reconstruction.
        metric: "l1" is the absolute difference, "ssim" is (1 - SSIM) / 2 with a 3 x 3 window, which must be fully
            visible.

    Returns:
        N x H x W float32 in [0, 1], NaN where no source frame is valid.
    """
    image, reconstructions = image.float()[:, None], reconstructions.float()
    if metric == "l1":
        error, seen = (reconstructions - image).abs(), visible[:, :, 0]
    else:
        error = ((1.0 - ssim(reconstructions, image)) / 2.0).clamp(0.0, 1.0)
        seen = wholly_visible(visible[:, :, 0])
    total = torch.where(seen, error.mean(dim=2), 0.0).sum(dim=1)
    return total / seen.sum(dim=1)  # 0 / 0 = NaN where no source frame is valid
