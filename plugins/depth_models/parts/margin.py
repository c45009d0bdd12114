"""A margin around a network's input, which keeps the zero padding of its convolutions away from the image."""

import torch
from torch import Tensor
from torch.nn import functional

from deux.errors import DeuxError


def check_margin(margin: int) -> None:
    """Raise DeuxError unless the margin is a number of pixels."""
    if margin < 0:
        raise DeuxError(f"margin={margin} is no number of pixels: it must be at least 0.")


def repeat_edge(image: Tensor, margin: int) -> Tensor:
    """Extend images by `margin` pixels on all sides, each the nearest pixel's value; channels last in memory."""
    extended = functional.pad(image, (margin,) * 4, mode="replicate")
    return extended.contiguous(memory_format=torch.channels_last)


def surround_with_zeros(points: Tensor, margin: int) -> Tensor:
    """Extend maps of sparse points by `margin` pixels without a point on all sides."""
    return functional.pad(points, (margin,) * 4)


def move_principal_point(intrinsics: Tensor, margin: int) -> Tensor:
    """The camera matrices, N x 3 x 3, of images that are extended by `margin` pixels on all sides."""
    shift = torch.zeros_like(intrinsics)
    shift[:, :2, 2] = margin
    return intrinsics + shift


def crop(output: Tensor, margin: int) -> Tensor:
    """Take the margin off again."""
    height, width = output.shape[-2:]
    return output[..., margin : height - margin, margin : width - margin]
