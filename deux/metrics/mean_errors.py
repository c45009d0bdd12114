"""The error metrics of depth completion averaged over images, as a torchmetrics class."""

import torch
from torch import Tensor
from torchmetrics import Metric
from torchmetrics.utilities.prints import rank_zero_warn

from deux.errors import counted
from deux.metrics.depth_errors import METRICS, depth_errors, invalid_pixels


class DepthErrors(Metric):
    """Mean of `depth_errors` over images, as in the published evaluations.

    Images without ground truth in range are ignored. Invalid predictions make all means infinite, so that model
    selection never prefers them, and `compute` warns of their number. Only `compute` waits for the device.

    Args:
        min_depth: ground truth at or below it is ignored, metres.
        max_depth: ground truth at or above it is ignored, metres.
        alone: do not synchronise with other processes in distributed training.
    """

    full_state_update = False
    higher_is_better = False
    sums: Tensor
    images: Tensor
    invalid: Tensor

    def __init__(self, min_depth: float = 0.1, max_depth: float = 10.0, alone: bool = False) -> None:
        super().__init__(sync_on_compute=not alone)
        self.min_depth = min_depth
        self.max_depth = max_depth
        self.add_state("sums", torch.zeros(len(METRICS), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("images", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("invalid", torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")

    def update(self, predicted_depth: Tensor, ground_truth: Tensor) -> None:
        """Add a batch of predictions and ground truth, both N x 1 x H x W metres."""
        errors = depth_errors(predicted_depth, ground_truth, self.min_depth, self.max_depth)
        has_truth = ~errors["mae"].isnan()  # ground truth in range
        self.sums += torch.where(has_truth, torch.stack([errors[name] for name in METRICS]), 0.0).sum(dim=1)
        self.images += has_truth.sum()
        self.invalid += invalid_pixels(predicted_depth, ground_truth, self.min_depth, self.max_depth).sum()

    def compute(self) -> dict[str, Tensor]:
        """The mean of each metric in mm or 1/km; NaN if no image had ground truth in range."""
        if (invalid := int(self.invalid)) > 0:
            rank_zero_warn(
                f"The predicted depth is not finite or not above 0 at {counted(invalid, 'pixel')} with ground truth "
                f"of {counted(int(self.images), 'image')}: their error counts as infinite."
            )
        return dict(zip(METRICS, self.sums / self.images, strict=True))
