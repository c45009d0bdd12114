"""The decoder with skip connections that the published depth models share."""

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from deux.geometry.tuned_forms import fuses_steps
from deux_plugins.depth_models.parts.convolution import Convolution

Size = tuple[int, int]


MERGE_PIXELS = 128
"""Number of pixels from which on merging the upsampling into the kernel is faster, at batch sizes of 2 and above.

It does not depend on the batch size, because a sample's result must not depend on other samples.
"""


def doubling_kernel(weight: Tensor) -> Tensor:
    """The kernel that merges nearest-neighbour upsampling by 2 with a 3 x 3 convolution.

    The merged operation is a transposed convolution of stride 2 and padding 1, with the flipped 3 x 3 kernel summed
    over 2 x 2 windows: 16 instead of 36 products per pixel. The sums of all kernels are computed as one product with a
    9 x 16 matrix, which takes half the time of adding shifted views.

    Args:
        weight: out x in x 3 x 3.

    Returns:
        in x out x 4 x 4.
    """
    unit_kernels = torch.eye(9, dtype=weight.dtype, device=weight.device).view(9, 3, 3)
    padded = functional.pad(unit_kernels.flip(1, 2), (1, 1, 1, 1))
    rows = padded[:, :-1] + padded[:, 1:]
    sums = (rows[:, :, :-1] + rows[:, :, 1:]).flatten(1)
    return (weight.transpose(0, 1).flatten(2) @ sums).unflatten(2, (4, 4))


class UpConvolution(nn.Module):
    """Nearest-neighbour upsampling, then a 3 x 3 convolution."""

    def __init__(self, in_channels: int, out_channels: int, batch_norm: bool = False) -> None:
        super().__init__()
        self.conv = Convolution(in_channels, out_channels, batch_norm=batch_norm)

    def forward(self, x: Tensor, size: Size) -> Tensor:
        """N x in_channels x h x w to N x out_channels x H x W, where size = (H, W)."""
        height, width = x.shape[2:]
        merged = fuses_steps() and height * width >= MERGE_PIXELS
        if size != (2 * height, 2 * width) or not merged:
            return self.conv(functional.interpolate(x, size))
        kernel = doubling_kernel(self.conv.conv.weight)
        return self.conv.finish(functional.conv_transpose2d(x, kernel, stride=2, padding=1))


class DecoderBlock(nn.Module):
    """One level of the decoder: upsample, concatenate the skip connection if there is one, convolve."""

    def __init__(self, in_channels: int, skip_channels: int, out_channels: int, batch_norm: bool = False) -> None:
        super().__init__()
        self.deconv = UpConvolution(in_channels, out_channels, batch_norm)
        self.conv = Convolution(out_channels + skip_channels, out_channels, batch_norm=batch_norm)

    def forward(self, x: Tensor, skip: Sequence[Tensor], size: Size) -> Tensor:
        """Upsample `x` to `size` and concatenate the tensors of `skip`, which may be empty."""
        x = self.deconv(x, size)
        return self.conv(torch.cat([x, *skip], dim=1) if skip else x)


class Decoder(nn.Module):
    """Decodes from the latent code to level `last` (0 is the full size, 1 half of it), then a linear 3 x 3 convolution.

    The blocks are named deconv4 ... deconv0 and the output layer output<last>, as in the published checkpoints.

    Args:
        latent_channels: channels of the latent code at 1/32 of the size.
        skip_channels: channels of the skip connection at each level, from 1/16 of the size upwards; 0 for none.
        filters: channels of each level's convolutions, in the same order.
        out_channels: channels of the output.
        batch_norm: whether the convolutions are normalised (never the output).
    """

    def __init__(
        self,
        latent_channels: int,
        skip_channels: Sequence[int],
        filters: Sequence[int],
        out_channels: int = 1,
        batch_norm: bool = False,
    ) -> None:
        super().__init__()
        channels = latent_channels
        self.levels = list(range(4, 4 - len(filters), -1))
        for level, skip, width in zip(self.levels, skip_channels, filters, strict=True):
            self.add_module(f"deconv{level}", DecoderBlock(channels, skip, width, batch_norm))
            channels = width
        self.add_module(f"output{self.levels[-1]}", Convolution(channels, out_channels, activation="linear"))

    @property
    def output(self) -> Convolution:
        """The output layer."""
        return cast(Convolution, self.get_submodule(f"output{self.levels[-1]}"))

    def forward(self, latent: Tensor, skips: Sequence[Sequence[Tensor]], sizes: Sequence[Size]) -> Tensor:
        """Decode.

        Args:
            latent: N x latent_channels x h x w.
            skips: the tensors to concatenate at each level, from 1/16 of the size upwards.
            sizes: (height, width) of each level, in the same order.

        Returns:
            N x out_channels x H x W float32, also under autocast and for networks in half precision, in which 8 bits of
            mantissa before the sigmoid would quantise depth by more than 1 %; float64 for networks in float64.
        """
        x = latent
        for level, skip, size in zip(self.levels, skips, sizes, strict=True):
            x = self.get_submodule(f"deconv{level}")(x, skip, size)
        weight = self.output.conv.weight
        dtype = torch.promote_types(torch.promote_types(x.dtype, weight.dtype), torch.float32)
        with torch.autocast(x.device.type, enabled=False):
            if self.training and fuses_steps():
                return convolve_to_few_channels(x.to(dtype), weight)
            if weight.dtype == dtype:
                return self.output(x.to(dtype))
            return functional.conv2d(x.to(dtype), weight.to(dtype), padding=1)


def convolve_to_few_channels(x: Tensor, weight: Tensor) -> Tensor:
    """A 3 x 3 convolution of stride 1 with zero padding, optimised for few output channels.

    One matrix product gives each pixel's contributions to its nine neighbours, which are then summed. oneDNN's
    convolution uses vector registers poorly with one output channel: forward and backward take 2 to 3 times as long at
    64 input channels, and 1.1 to 1.6 times as long at 12 to 32.

    Args:
        x: N x in x H x W, channels-last memory format.
        weight: out x in x 3 x 3.

    Returns:
        N x out x H x W in the promoted type of both.
    """
    dtype = torch.promote_types(x.dtype, weight.dtype)
    kernels = weight.to(dtype).flip(2, 3).transpose(0, 1).flatten(1)
    columns = x.to(dtype).permute(0, 2, 3, 1).flatten(1, 2) @ kernels
    return functional.fold(columns.transpose(1, 2), x.shape[2:], kernel_size=3, padding=1)
