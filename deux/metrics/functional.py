"""The four error measures of depth completion, one value per image.

All of them compare pixels whose ground truth lies strictly inside (min_depth, max_depth); the prediction is
not clamped. An image without such a pixel gives NaN.
"""

import torch
from torch import Tensor


def depth_errors(
    predicted_depth: Tensor, ground_truth: Tensor, min_depth: float = 0.1, max_depth: float = 10.0
) -> dict[str, Tensor]:
    """Errors of each image of a batch.

    Args:
        predicted_depth: N x 1 x H x W metres, positive.
        ground_truth: N x 1 x H x W metres, 0 = none.
        min_depth: ground truth at or below it is left out, metres.
        max_depth: ground truth at or above it is left out, metres.

    Returns:
        N float64 values each: `mae` and `rmse` in millimetres, `imae` and `irmse` in 1/km.

    Example:
        >>> errors = depth_errors(torch.full((1, 1, 2, 2), 2.0), torch.full((1, 1, 2, 2), 4.0))
        >>> {name: round(value.item(), 3) for name, value in errors.items()}
        {'mae': 2000.0, 'rmse': 2000.0, 'imae': 250.0, 'irmse': 250.0}
    """
    counted = (ground_truth > min_depth) & (ground_truth < max_depth)
    truth, predicted = ground_truth.double(), predicted_depth.double()
    number = counted.flatten(1).sum(dim=1)

    def mean(values: Tensor) -> Tensor:
        return torch.where(counted, values, 0.0).flatten(1).sum(dim=1) / number

    millimetres = 1000.0 * (predicted - truth)
    per_kilometre = 1000.0 * (1.0 / predicted - 1.0 / truth)
    return {
        "mae": mean(millimetres.abs()),
        "rmse": mean(millimetres.square()).sqrt(),
        "imae": mean(per_kilometre.abs()),
        "irmse": mean(per_kilometre.square()).sqrt(),
    }
