"""KBNet's first layer, which spreads sparse points over their neighbourhood."""

import torch
from torch import Tensor, nn

from deux.geometry.sliding_max import sliding_max
from deux_plugins.depth_models.parts.convolution import Convolution
from deux_plugins.depth_models.parts.pooling import check_windows, sliding_min_of_points


class SparseToDensePool(nn.Module):
    """Minima and maxima of sparse depth in windows of several sizes, combined by convolutions.

    Args:
        min_pools: sides of the windows of the minima, in pixels.
        max_pools: sides of the windows of the maxima, in pixels.
        filters: channels of the convolutions and of the output.
        convolutions: number of 1 x 1 convolutions over the pools.
    """

    def __init__(
        self, min_pools: tuple[int, ...], max_pools: tuple[int, ...], filters: int = 8, convolutions: int = 3
    ) -> None:
        super().__init__()
        check_windows("min_pools", min_pools)
        check_windows("max_pools", max_pools)
        self.min_pools = min_pools
        self.max_pools = max_pools
        channels = [len(min_pools) + len(max_pools)] + [filters] * convolutions
        self.pool_convs = nn.Sequential(
            *(Convolution(channels[i], channels[i + 1], kernel=1) for i in range(convolutions))
        )
        self.conv = Convolution(filters + 2, filters)

    def forward(self, sparse_depth: Tensor, validity: Tensor) -> Tensor:
        """Sparse depth (metres, 0 = none) and validity, each N x 1 x H x W, to N x filters x H x W."""
        nearest = [sliding_min_of_points(sparse_depth, window) for window in self.min_pools]
        farthest = [sliding_max(sparse_depth, window) for window in self.max_pools]
        pools = self.pool_convs(torch.cat(nearest + farthest, dim=1))
        points = torch.cat([sparse_depth, validity], dim=1).to(pools.dtype, memory_format=torch.channels_last)
        return self.conv(torch.cat([pools, points], dim=1))
