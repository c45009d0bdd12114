"""Relative error of the predicted depth against ground truth (ScaffNet); for supervised models only."""

import torch
from torch import Tensor

from deux.contracts import LossInputs, LossNeed, LossTerm
from deux_plugins.losses.photometric import Divisor

EPSILON = 1e-8


class SupervisedDepth(LossTerm):
    """Mean over the pixels of v |d - g| / (|g| + 1e-8), where g is the ground truth and v is 1 where it exists, else 0.

    Ground truth is clamped to the farthest depth that the model predicts, as published.

    Args:
        divisor: divide by the number of all pixels in the image (published), or of those with ground truth in each
            frame. A frame without any contributes zero.
    """

    needs = frozenset({LossNeed.GROUND_TRUTH})

    def __init__(self, divisor: Divisor = "image") -> None:
        self.divisor = divisor

    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value, without unit."""
        assert inputs.batch.ground_truth is not None
        truth = inputs.batch.ground_truth.float().clamp(max=inputs.depth_range[1])
        valid = truth > 0
        error = (inputs.prediction.depth.float() - truth).abs() / (truth.abs() + EPSILON)
        total = torch.where(valid, error, 0.0).sum(dim=(1, 2, 3))
        if self.divisor == "image":
            return (total / truth[0].numel()).mean()
        return (total / valid.sum(dim=(1, 2, 3)).clamp(min=1)).mean()
