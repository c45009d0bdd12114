"""Convolutions of small maps for training in bfloat16 on a CPU, with the weights' gradient as a matrix product."""

from typing import Any

import torch
from torch import Tensor
from torch.nn import functional
from torch.nn.grad import conv2d_input

from deux.geometry.tuned_forms import tuned_for_cpu

MAX_PIXELS = 288
"""Total number of output pixels of a batch up to which the matrix product is faster than oneDNN's convolution.

The gradient of the weights is a sum over the batch anyway, so no sample's result depends on other samples.
"""


def is_small_map(x: Tensor, weight: Tensor, stride: int) -> bool:
    """Whether `convolve_small_map` is faster: on a CPU, in bfloat16, if the weights are trained."""
    if not (tuned_for_cpu(x) and weight.requires_grad and torch.is_grad_enabled()):
        return False
    height, width = (-(-length // stride) for length in x.shape[-2:])
    small = height * width == 1 or len(x) * height * width <= MAX_PIXELS
    return small and _dtype(weight) == torch.bfloat16


def convolve_small_map(x: Tensor, weight: Tensor, stride: int) -> Tensor:
    """A convolution with zero padding of k // 2, equal to `functional.conv2d`.

    For the gradient of the weights, oneDNN (PyTorch 2.14) takes 1.1 to 5 times as long as the product of the output's
    gradient with the unfolded windows, and at stride 2 on a map of one pixel it does not write that gradient at all.

    Args:
        x: N x in x H x W.
        weight: out x in x k x k, k odd; both are converted to the dtype of an enclosing autocast.
        stride: stride in both directions.

    Returns:
        N x out x ceil(H / stride) x ceil(W / stride).
    """
    dtype = _dtype(weight)
    with torch.autocast(x.device.type, enabled=False):
        return _SmallMapConvolution.apply(x.to(dtype), weight.to(dtype), stride)


def _dtype(weight: Tensor) -> torch.dtype:
    """The dtype in which a convolution with these weights is computed."""
    device = weight.device.type
    return torch.get_autocast_dtype(device) if torch.is_autocast_enabled(device) else weight.dtype


class _SmallMapConvolution(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, stride: int) -> Tensor:
        ctx.save_for_backward(x, weight)
        ctx.stride = stride
        return functional.conv2d(x, weight, stride=stride, padding=weight.shape[-1] // 2)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        x, weight = ctx.saved_tensors
        (gradient,) = gradients
        x_gradient, weight_gradient = None, None
        if ctx.needs_input_grad[0]:
            padding = weight.shape[-1] // 2
            x_gradient = conv2d_input(x.shape, weight, gradient, stride=ctx.stride, padding=padding)
        if ctx.needs_input_grad[1]:
            kernel = weight.shape[-1]
            rows = gradient.permute(0, 2, 3, 1).flatten(0, 2)
            product = rows.T @ _windows(x, kernel, ctx.stride)
            weight_gradient = product.unflatten(1, (kernel, kernel, -1)).permute(0, 3, 1, 2)
        return x_gradient, weight_gradient, None


def _windows(x: Tensor, kernel: int, stride: int) -> Tensor:
    """Unfold the k x k windows of N x C x H x W with zero padding: (N H' W') x (k k C)."""
    padded = functional.pad(x.permute(0, 2, 3, 1), (0, 0, *[kernel // 2] * 4))
    windows = padded.unfold(1, kernel, stride).unfold(2, kernel, stride)
    return windows.permute(0, 1, 2, 4, 5, 3).flatten(0, 2).flatten(1)
