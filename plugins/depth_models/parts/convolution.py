"""The convolution layers of the published depth models."""

from typing import Literal

import torch
from torch import Tensor, nn

from deux_plugins.depth_models.parts.small_map_convolution import convolve_small_map, is_small_map

Activation = Literal["leaky_relu", "relu", "linear"]


def activation_layer(name: Activation) -> nn.Module:
    """Make an activation; the published LeakyReLU has a slope of 0.2."""
    if name == "leaky_relu":
        return nn.LeakyReLU(0.2, inplace=True)
    return nn.ReLU(inplace=True) if name == "relu" else nn.Identity()


class Convolution(nn.Module):
    """A k x k convolution without bias, optional batch normalisation, then an activation.

    Zero padding of k // 2 preserves the size at stride 1 and gives ceil(size / 2) at stride 2. The weights are
    initialised by Glorot's normal distribution, as in all published trainings. They are in channels-last memory format,
    and so are the outputs, because this is faster on CPUs and GPUs.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel: int = 3,
        stride: int = 1,
        activation: Activation = "leaky_relu",
        batch_norm: bool = False,
    ) -> None:
        super().__init__()
        convolution = nn.Conv2d(in_channels, out_channels, kernel, stride, padding=kernel // 2, bias=False)
        nn.init.xavier_normal_(convolution.weight)
        self.conv = convolution.to(memory_format=torch.channels_last)
        self.batch_norm = nn.BatchNorm2d(out_channels) if batch_norm else nn.Identity()
        self.activation = activation_layer(activation)

    def forward(self, x: Tensor) -> Tensor:
        """N x in_channels x H x W to N x out_channels x H' x W'."""
        weight, (stride, _) = self.conv.weight, self.conv.stride
        if is_small_map(x, weight, stride):
            return self.finish(convolve_small_map(x, weight, stride))
        return self.finish(self.conv(x))

    def finish(self, x: Tensor) -> Tensor:
        """Apply normalisation and activation to the output of the convolution."""
        return self.activation(self.batch_norm(x))


class ConvolutionBlock(nn.Module):
    """3 x 3 convolutions in a row (a VGG block); the last one has the stride."""

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        convolutions: int = 1,
        stride: int = 1,
        batch_norm: bool = False,
    ) -> None:
        super().__init__()
        channels = [in_channels] + [out_channels] * convolutions
        strides = [1] * (convolutions - 1) + [stride]
        self.conv_block = nn.Sequential(
            *(
                Convolution(channels[i], channels[i + 1], stride=strides[i], batch_norm=batch_norm)
                for i in range(convolutions)
            )
        )

    def forward(self, x: Tensor) -> Tensor:
        """N x in_channels x H x W to N x out_channels x H' x W'."""
        return self.conv_block(x)
