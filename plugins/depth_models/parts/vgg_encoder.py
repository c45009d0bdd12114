"""The VGG encoders of VOICED, ScaffNet and FusionNet, and how two of them are joined."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from deux.errors import DeuxError
from deux_plugins.depth_models.parts.convolution import Convolution, ConvolutionBlock

LEVELS = 5

VGG8 = (1, 1, 1, 1, 1)
"""Convolutions in each block of the published vggnet08."""

VGG11 = (1, 1, 2, 2, 2)
"""Convolutions in each block of the published vggnet11."""


class VGGEncoder(nn.Module):
    """Five blocks of convolutions, each half the size of the one before: a 5 x 5 convolution, then VGG blocks.

    Args:
        in_channels: channels of the input.
        filters: channels of the five blocks.
        convolutions: number of convolutions in each block, `VGG8` or `VGG11`.
        batch_norm: whether the convolutions are normalised.
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


def joined(image_features: Sequence[Tensor], depth_features: Sequence[Tensor]) -> list[Tensor]:
    """The features of both branches side by side at each level (late fusion)."""
    return [torch.cat(pair, dim=1) for pair in zip(image_features, depth_features, strict=True)]


def sizes(features: Sequence[Tensor]) -> list[tuple[int, int]]:
    """(height, width) of each level that a decoder comes to, from 1/16 of the size upwards."""
    return [(level.shape[2], level.shape[3]) for level in reversed(features[:-1])]


def check_levels(**filters: Sequence[int]) -> None:
    """Raise DeuxError unless each option holds one number of channels for every level of the encoder."""
    for option, values in filters.items():
        if len(values) != LEVELS:
            raise DeuxError(f"{option}={values} has {len(values)} entries: the network has {LEVELS} levels.")
