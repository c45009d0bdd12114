"""Conversion of a network's unbounded output to depth in metres."""

from typing import Any

import torch
from torch import Tensor

from deux.errors import DeuxError

FARTHEST, NEAREST = 5e-4, 0.95
"""Values of nearness between which the gradient is clamped: within about 5 % of the ends of 0.1 to 10 m."""


def check_depth_range(min_depth: float, max_depth: float, prefix: str = "") -> None:
    """Raise DeuxError unless 0 < min_depth < max_depth; `prefix` begins the names of the two options."""
    if not 0.0 < min_depth < max_depth:
        near, far = f"{prefix}min_depth", f"{prefix}max_depth"
        raise DeuxError(f"{near}={min_depth} and {far}={max_depth} must satisfy 0 < {near} < {far} (metres).")


def depth_from_nearness(nearness: Tensor, min_depth: float, max_depth: float) -> Tensor:
    """Depth in metres, d = d_min / (s + d_min / d_max), from s in [0, 1]: inverse depth grows linearly with s.

    The range is (d_min / (1 + d_min / d_max), d_max), so the nearest depth lies slightly below d_min.
    """
    return min_depth / (nearness + min_depth / max_depth)


def nearness_from_logits(logits: Tensor) -> Tensor:
    """Nearness s = sigmoid(x) in [0, 1] from the network's unbounded output x.

    In training the gradient does not vanish at the ends: beyond `FARTHEST` and `NEAREST` it is the gradient at these
    values. Otherwise the outputs could not recover from a bad step far beyond an end, where the sigmoid's gradient is 0
    in float32.
    """
    return _Nearness.apply(logits) if torch.is_grad_enabled() and logits.requires_grad else torch.sigmoid(logits)


def depth_from_logits(logits: Tensor, min_depth: float, max_depth: float) -> Tensor:
    """Depth in metres from the network's unbounded output: `depth_from_nearness` of `nearness_from_logits`."""
    return depth_from_nearness(nearness_from_logits(logits), min_depth, max_depth)


def recoverable_clamp(values: Tensor, lowest: float, highest: float) -> Tensor:
    """Clamp values to [lowest, highest] with a gradient from which they can recover.

    In training the gradient of a value outside of the range passes if a step against it leads back into the range. The
    gradient of `torch.clamp` is 0 there, so that values could not recover from a bad step.
    """
    if torch.is_grad_enabled() and values.requires_grad:
        return _RecoverableClamp.apply(values, lowest, highest)
    return values.clamp(lowest, highest)


class _Nearness(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, logits: Tensor) -> Tensor:
        nearness = torch.sigmoid(logits)
        ctx.save_for_backward(nearness)
        return nearness

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        (nearness,) = ctx.saved_tensors
        return torch.ops.aten.sigmoid_backward(gradient, nearness.clamp(FARTHEST, NEAREST))


class _RecoverableClamp(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, lowest: float, highest: float) -> Tensor:
        ctx.save_for_backward(values)
        ctx.ends = lowest, highest
        return values.clamp(lowest, highest)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        (values,) = ctx.saved_tensors
        lowest, highest = ctx.ends
        passes = ((values > lowest) | (gradient < 0)) & ((values < highest) | (gradient > 0))
        return torch.where(passes, gradient, 0.0), None, None
