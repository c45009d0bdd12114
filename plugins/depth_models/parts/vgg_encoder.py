"""The VGG encoders of VOICED, ScaffNet and FusionNet."""

from collections.abc import Sequence

from torch import Tensor, nn

from deux_plugins.depth_models.parts.convolution import Convolution, ConvolutionBlock
from deux_plugins.depth_models.parts.levels import LEVELS

VGG8 = (1, 1, 1, 1, 1)
"""Convolutions in each block of the published vggnet08."""

VGG11 = (1, 1, 2, 2, 2)
"""Convolutions in each block of the published vggnet11."""


class VGGEncoder(nn.Module):
    """Five blocks, each with half the size of the previous one: a 5 x 5 convolution, then four VGG blocks.

    Args:
        in_channels: channels of the input.
        filters: channels of the five blocks.
        convolutions: number of convolutions in each block, `VGG8` or `VGG11`.
        batch_norm: whether to use batch normalisation.
    """

    def __init__(
        self,
        in_channels: int,
        filters: Sequence[int],
        convolutions: Sequence[int] = VGG8,
        batch_norm: bool = False,
    ) -> None:
        super().__init__()
        self.conv1 = Convolution(in_channels, filters[0], kernel=5, stride=2, batch_norm=batch_norm)
        for level in range(1, LEVELS):
            block = ConvolutionBlock(filters[level - 1], filters[level], convolutions[level], 2, batch_norm)
            self.add_module(f"conv{level + 1}", block)

    def forward(self, x: Tensor) -> list[Tensor]:
        """N x in_channels x H x W to the five blocks' features, from 1/2 of the size to 1/32."""
        features = []
        for block in self.children():
            x = block(x)
            features.append(x)
        return features
