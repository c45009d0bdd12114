"""Padding of a network's input, to keep the zero padding of its convolutions away from the image."""

import torch
from torch import Tensor
from torch.nn import functional

from deux.errors import DeuxError


def check_margin(margin: int) -> None:
    """Raise DeuxError if the margin is negative."""
    if margin < 0:
        raise DeuxError(f"margin={margin} is not a number of pixels: it must be at least 0.")


def repeat_edge(image: Tensor, margin: int) -> Tensor:
    """Pad images by `margin` pixels on all sides with the values of the edge; the result is channels-last."""
    extended = functional.pad(image, (margin,) * 4, mode="replicate")
    return extended.contiguous(memory_format=torch.channels_last)


def surround_with_zeros(points: Tensor, margin: int) -> Tensor:
    """Pad maps of sparse points by `margin` pixels on all sides with 0 (no point)."""
    return functional.pad(points, (margin,) * 4)


def move_principal_point(intrinsics: Tensor, margin: int) -> Tensor:
    """The camera matrices, N x 3 x 3, of images that are padded by `margin` pixels on all sides."""
    shift = torch.zeros_like(intrinsics)
    shift[:, :2, 2] = margin
    return intrinsics + shift


def crop(output: Tensor, margin: int) -> Tensor:
    """Crop the margin from an output."""
    height, width = output.shape[-2:]
    return output[..., margin : height - margin, margin : width - margin]
