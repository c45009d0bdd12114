"""From a network's unbounded output to metres."""

import torch
from torch import Tensor

from deux.errors import DeuxError


def check_depth_range(min_depth: float, max_depth: float) -> None:
    """Raise DeuxError unless 0 < min_depth < max_depth."""
    if not 0.0 < min_depth < max_depth:
        raise DeuxError(
            f"min_depth={min_depth} and max_depth={max_depth} are no depth range: 0 < min_depth < max_depth (metres)."
        )


def depth_from_nearness(nearness: Tensor, min_depth: float, max_depth: float) -> Tensor:
    """Depth in metres, d = d_min / (s + d_min / d_max), from s in [0, 1]: inverse depth grows linearly with s.

    The range is (d_min / (1 + d_min / d_max), d_max), so the nearest depth lies slightly below d_min.
    """
    return min_depth / (nearness + min_depth / max_depth)


def depth_from_logits(logits: Tensor, min_depth: float, max_depth: float) -> Tensor:
    """Depth in metres from the network's unbounded output x: `depth_from_nearness` of sigmoid(x)."""
    return depth_from_nearness(torch.sigmoid(logits), min_depth, max_depth)
