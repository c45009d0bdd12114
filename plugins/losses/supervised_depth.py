"""Agreement of the predicted depth with the ground truth, relative to it (ScaffNet). For supervised models only."""

import torch
from torch import Tensor

from deux.contracts import Batch, LossNeed, LossTerm, Prediction, Reconstructions
from deux.errors import check_range
from deux_plugins.losses.photometric import Divisor

EPSILON = 1e-8


class SupervisedDepth(LossTerm):
    """Mean over the pixels of v |d - g| / (|g| + 1e-8), g being the ground truth and v 1 where there is any, else 0.

    Args:
        max_depth: metres; ground truth beyond is taken for this, the farthest that the model can predict.
        divisor: divide by the number of all pixels in the image (published), or of those with ground truth, frame by
            frame. A frame without any adds zero.
    """

    needs = frozenset({LossNeed.GROUND_TRUTH})

    def __init__(self, max_depth: float = 10.0, divisor: Divisor = "image") -> None:
        check_range("supervised_depth's max_depth", max_depth, 0.0, ends=False)
        self.max_depth = max_depth
        self.divisor = divisor

    def __call__(self, batch: Batch, prediction: Prediction, reconstructions: Reconstructions | None) -> Tensor:
        """The term's value, without unit."""
        assert batch.ground_truth is not None
        truth = batch.ground_truth.float().clamp(max=self.max_depth)
        valid = truth > 0
        error = (prediction.depth.float() - truth).abs() / (truth.abs() + EPSILON)
        total = torch.where(valid, error, 0.0).sum(dim=(1, 2, 3))
        if self.divisor == "image":
            return (total / truth[0].numel()).mean()
        return (total / valid.sum(dim=(1, 2, 3)).clamp(min=1)).mean()
