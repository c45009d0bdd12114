"""KBNet's encoder: an image branch, a depth branch, and a fused branch of features backprojected to 3D."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from deux_plugins.depth_models.kbnet.rays import camera_rays
from deux_plugins.depth_models.parts.convolution import Convolution, ConvolutionBlock
from deux_plugins.depth_models.parts.decoder import Size

CALIBRATED_LEVELS = 4
"""Levels 0 to 3 backproject; level 4 is plain."""


def halve(x: Tensor) -> Tensor:
    """Every second pixel of every second row; the result and its gradient keep the memory format of `x`."""
    return _Halve.apply(x)


def _every_second(x: Tensor) -> Tensor:
    return x[:, :, ::2, ::2].contiguous(memory_format=_layout(x))


def _layout(x: Tensor) -> torch.memory_format:
    last = x.is_contiguous(memory_format=torch.channels_last)
    return torch.channels_last if last else torch.contiguous_format


class _Halve(torch.autograd.Function):
    """Slicing with a channels-last gradient: that of plain slicing is channels-first, which slows down later steps."""

    @staticmethod
    def forward(context: Any, x: Tensor) -> Tensor:
        context.size, context.layout = x.shape, _layout(x)
        return _every_second(x)

    @staticmethod
    def backward(context: Any, gradient: Tensor) -> Tensor:
        whole = torch.empty(
            context.size, dtype=gradient.dtype, device=gradient.device, memory_format=context.layout
        ).zero_()
        whole[:, :, ::2, ::2] = gradient
        return whole


class CalibratedBackprojection(nn.Module):
    """Backprojects the depth branch's features with the camera's intrinsics and joins them to the image's.

    Args:
        image_channels: input channels of the image branch.
        depth_channels: input channels of the depth branch.
        fused_channels: input channels of the fused branch, 0 at the first layer.
        image_filters: output channels of the image branch and of the fused branch.
        depth_filters: output channels of the depth branch.
        image_output: whether the image branch continues after this layer. It does not after the last one, whose
            convolution is kept only for published checkpoints, which contain it; it is never used or trained.
    """

    def __init__(
        self,
        image_channels: int,
        depth_channels: int,
        fused_channels: int,
        image_filters: int,
        depth_filters: int,
        image_output: bool = True,
    ) -> None:
        super().__init__()
        self.image_output = image_output
        self.conv_image = ConvolutionBlock(image_channels, image_filters, stride=2)
        self.conv_image.requires_grad_(image_output)
        self.conv_depth = ConvolutionBlock(depth_channels + 3, depth_filters, stride=2)
        self.proj_depth = Convolution(depth_channels, 1, kernel=1)
        self.conv_fused = Convolution(image_channels + 3 + fused_channels, image_filters, kernel=1)

    def forward(
        self, image: Tensor, depth: Tensor, rays: Tensor, fused: Tensor | None
    ) -> tuple[Tensor | None, Tensor, Tensor]:
        """One level down.

        Args:
            image: N x image_channels x H x W.
            depth: N x depth_channels x H x W.
            rays: N x 3 x H x W float32.
            fused: N x fused_channels x H x W, None at the first layer.

        Returns:
            The image branch (None unless `image_output`), the depth branch and the fused branch at half the size.
        """
        next_image = self.conv_image(image) if self.image_output else None
        next_depth = self.conv_depth(torch.cat([depth, rays.to(depth.dtype)], dim=1))
        # The published 1 x 1 convolutions of stride 2 read every second pixel: only those are backprojected.
        points = halve(rays) * self.proj_depth(halve(depth))
        fused_inputs = [halve(image), points.to(image.dtype)]
        if fused is not None:
            fused_inputs.append(halve(fused))
        return next_image, next_depth, self.conv_fused(torch.cat(fused_inputs, dim=1))


class KBNetEncoder(nn.Module):
    """Five levels, each half the size of the one before.

    Args:
        depth_channels: channels of the sparse-to-dense features.
        image_filters: channels of the image and fused branches, level by level.
        depth_filters: channels of the depth branch, level by level.
    """

    def __init__(self, depth_channels: int, image_filters: Sequence[int], depth_filters: Sequence[int]) -> None:
        super().__init__()
        self.conv0_image = Convolution(3, image_filters[0])
        self.conv0_depth = Convolution(depth_channels, depth_filters[0])
        image, depth, fused = image_filters[0], depth_filters[0], 0
        for level in range(CALIBRATED_LEVELS):
            wide, deep = image_filters[level], depth_filters[level]
            last = level == CALIBRATED_LEVELS - 1
            layer = CalibratedBackprojection(image, depth, fused, wide, deep, image_output=not last)
            self.add_module(f"calibrated_backprojection{level + 1}", layer)
            image, depth, fused = wide, deep, wide
        self.conv5_image = ConvolutionBlock(fused, image_filters[4], stride=2)
        self.conv5_depth = ConvolutionBlock(depth, depth_filters[4], stride=2)

    def forward(
        self, image: Tensor, depth: Tensor, intrinsics: Tensor
    ) -> tuple[Tensor, list[tuple[Tensor, ...]], list[Size]]:
        """Encode.

        Args:
            image: N x 3 x H x W in [0, 1].
            depth: N x depth_channels x H x W, the sparse-to-dense features.
            intrinsics: N x 3 x 3.

        Returns:
            The latent code at 1/32 of the size; the skip connections from 1/16 to 1/2, then none for the full size;
            the five sizes that belong to them.
        """
        size = full_size = (image.shape[2], image.shape[3])
        scale = (1.0, 1.0)
        skips: list[tuple[Tensor, ...]] = [()]
        sizes = [size]
        image, depth, fused = self.conv0_image(image), self.conv0_depth(depth), None
        for level in range(1, CALIBRATED_LEVELS + 1):
            layer = self.get_submodule(f"calibrated_backprojection{level}")
            image, depth, fused = layer(image, depth, camera_rays(intrinsics, size, scale), fused)
            size = (depth.shape[2], depth.shape[3])
            if level == 1:  # the published network keeps the first halving's ratio at all deeper levels
                scale = (size[0] / full_size[0], size[1] / full_size[1])
            skips.insert(0, (fused, depth))
            sizes.insert(0, size)
        latent = torch.cat([self.conv5_image(fused), self.conv5_depth(depth)], dim=1)
        return latent, skips, sizes
