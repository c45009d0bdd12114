"""A small depth completion network on sparse depth that pooling has filled in."""

from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from deux.contracts import DepthModel, LossSettings, Prediction


class PooledNetwork(DepthModel):
    """Fills the sparse depth by averaging over growing windows and corrects the result with a few convolutions.

    Args:
        channels: number of channels of the hidden layers.
        min_depth: nearest depth in metres that is predicted.
        max_depth: farthest depth in metres that is predicted.
    """

    objective: ClassVar[LossSettings] = {
        "color_consistency": 0.2,
        "structural_consistency": 0.8,
        "sparse_depth": 1.0,
        "second_order_smoothness": 0.1,
    }

    def __init__(self, channels: int = 16, min_depth: float = 0.1, max_depth: float = 10.0) -> None:
        super().__init__()
        self.min_depth = min_depth
        self.max_depth = max_depth
        self.correction = nn.Sequential(
            nn.Conv2d(4, channels, 3, padding=1),
            nn.ELU(),
            nn.Conv2d(channels, channels, 3, padding=2, dilation=2),
            nn.ELU(),
            nn.Conv2d(channels, 1, 3, padding=1),
        )

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        """Predict dense depth; shapes and units are those of `DepthModel.forward`."""
        filled = fill(sparse_depth, validity).clamp(self.min_depth, self.max_depth)
        correction = self.correction(torch.cat([image, filled.log()], dim=1)).float()
        depth = filled * torch.exp(torch.tanh(correction))
        return Prediction(depth.clamp(self.min_depth, self.max_depth))


def fill(sparse_depth: Tensor, validity: Tensor, windows: tuple[int, ...] = (63, 31, 15, 7, 3)) -> Tensor:
    """Dense depth, N x 1 x H x W metres: at each pixel the mean of the points in the smallest window that has any.

    Where no window has a point it is the mean of all points of the frame, and 1 m in a frame without points.
    """
    points = validity * (sparse_depth > 0)
    count = points.sum(dim=(2, 3), keepdim=True)
    mean = (points * sparse_depth).sum(dim=(2, 3), keepdim=True) / count.clamp(min=1)
    filled = torch.where(count > 0, mean, torch.ones_like(mean)).expand_as(sparse_depth)
    for window in windows:
        weight = functional.avg_pool2d(points, window, stride=1, padding=window // 2)
        total = functional.avg_pool2d(points * sparse_depth, window, stride=1, padding=window // 2)
        # Half a point is the threshold: pooling leaves rounding errors where there is none.
        filled = torch.where(weight * window**2 > 0.5, total / weight.clamp(min=1e-6), filled)
    return filled
