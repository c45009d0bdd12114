"""The error metrics of depth completion: MAE, RMSE, iMAE and iRMSE of each image.

All of them compare the pixels whose ground truth lies strictly inside (min_depth, max_depth); the prediction is not
clamped. Invalid predictions at these pixels (not finite, or not above 0) have an infinite error in all metrics; they
are not ignored.
"""

from typing import NamedTuple

import torch
from torch import Tensor


class DepthMetric(NamedTuple):
    """Title and unit of a metric for tables and figures.

    Args:
        title: the usual name in the literature.
        unit: unit of its values.
    """

    title: str
    unit: str

    @property
    def heading(self) -> str:
        """The name with the unit: "MAE [mm]"."""
        return f"{self.title} [{self.unit}]"


METRICS = {
    "mae": DepthMetric("MAE", "mm"),
    "rmse": DepthMetric("RMSE", "mm"),
    "imae": DepthMetric("iMAE", "1/km"),
    "irmse": DepthMetric("iRMSE", "1/km"),
}
"""The metrics by their keys in results and logs, in the order of the paper's tables."""


def depth_errors(
    predicted_depth: Tensor, ground_truth: Tensor, min_depth: float = 0.1, max_depth: float = 10.0
) -> dict[str, Tensor]:
    """Errors of each image of a batch, with d the prediction and g the ground truth in metres.

    MAE is the mean of |1000 d - 1000 g|, RMSE the root of the mean square; iMAE is the mean of |1000/d - 1000/g|, iRMSE
    the root of the mean square.

    Args:
        predicted_depth: N x 1 x H x W metres.
        ground_truth: N x 1 x H x W metres, 0 = none.
        min_depth: ground truth at or below it is ignored, metres.
        max_depth: ground truth at or above it is ignored, metres.

    Returns:
        N float64 values for each of `METRICS`, computed from float32 errors: NaN for images without ground truth in
        range, infinite for images with invalid predictions (`invalid_pixels`).

    Example:
        >>> errors = depth_errors(torch.full((1, 1, 2, 2), 2.0), torch.full((1, 1, 2, 2), 4.0))
        >>> {name: round(value.item(), 3) for name, value in errors.items()}
        {'mae': 2000.0, 'rmse': 2000.0, 'imae': 250.0, 'irmse': 250.0}
    """
    in_range = _in_range(ground_truth, min_depth, max_depth)
    valid = _is_depth(predicted_depth)
    truth, predicted = ground_truth.float(), predicted_depth.float()
    number = in_range.flatten(1).sum(dim=1)

    def mean(values: Tensor) -> Tensor:
        values = torch.where(valid, values, torch.inf)
        return torch.where(in_range, values, 0.0).flatten(1).sum(dim=1, dtype=torch.float64) / number

    millimetres = 1000.0 * (predicted - truth)
    per_kilometre = 1000.0 * (1.0 / predicted - 1.0 / truth)
    return {
        "mae": mean(millimetres.abs()),
        "rmse": mean(millimetres.square()).sqrt(),
        "imae": mean(per_kilometre.abs()),
        "irmse": mean(per_kilometre.square()).sqrt(),
    }


def invalid_pixels(
    predicted_depth: Tensor, ground_truth: Tensor, min_depth: float = 0.1, max_depth: float = 10.0
) -> Tensor:
    """Number of pixels of each image with ground truth in range whose prediction is not finite or not above 0.

    Args:
        predicted_depth: N x 1 x H x W metres.
        ground_truth: N x 1 x H x W metres, 0 = none.
        min_depth: ground truth at or below it is ignored, metres.
        max_depth: ground truth at or above it is ignored, metres.

    Returns:
        N int64 values.
    """
    invalid = _in_range(ground_truth, min_depth, max_depth) & ~_is_depth(predicted_depth)
    return invalid.flatten(1).sum(dim=1)


def _in_range(ground_truth: Tensor, min_depth: float, max_depth: float) -> Tensor:
    return (ground_truth > min_depth) & (ground_truth < max_depth)


def _is_depth(predicted_depth: Tensor) -> Tensor:
    return predicted_depth.isfinite() & (predicted_depth > 0)
