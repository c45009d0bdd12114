"""The error measures as a torchmetrics class, for Lightning and for several processes."""

import torch
from torch import Tensor
from torchmetrics import Metric

from deux.metrics.functional import depth_errors

METRIC_NAMES = ("mae", "rmse", "imae", "irmse")
"""The paper's four measures, in the order of its tables."""


class DepthMetrics(Metric):
    """Mean over images of the per-image errors, as the published evaluations average them.

    Args:
        min_depth: ground truth at or below it is left out, metres.
        max_depth: ground truth at or above it is left out, metres.
        alone: whether this process counts for itself, also where several train together.
    """

    full_state_update = False
    higher_is_better = False
    sums: Tensor
    images: Tensor

    def __init__(self, min_depth: float = 0.1, max_depth: float = 10.0, alone: bool = False) -> None:
        super().__init__(sync_on_compute=not alone)
        self.min_depth = min_depth
        self.max_depth = max_depth
        self.add_state("sums", torch.zeros(len(METRIC_NAMES), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("images", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")

    def update(self, predicted_depth: Tensor, ground_truth: Tensor) -> None:
        """Count a batch: both N x 1 x H x W metres. Images without ground truth in range are left out."""
        errors = depth_errors(predicted_depth, ground_truth, self.min_depth, self.max_depth)
        table = torch.stack([errors[name] for name in METRIC_NAMES], dim=1)
        counted = ~table[:, 0].isnan()
        self.sums += table[counted].sum(dim=0)
        self.images += counted.sum()

    def compute(self) -> dict[str, Tensor]:
        """The means, mm and 1/km; NaN if no image had ground truth."""
        return dict(zip(METRIC_NAMES, self.sums / self.images, strict=True))
