"""Agreement of the predicted depth with the sparse points (Eq. 6)."""

import torch
from torch import Tensor

from deux.contracts import LossInputs, LossTerm


class SparseDepth(LossTerm):
    """Mean absolute difference in metres at the sparse points that survive outlier removal.

    The mean is over each frame, then over the batch, as in the published models. A frame without points contributes
    zero, where the published code returns NaN.
    """

    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value in metres."""
        batch = inputs.batch
        valid = batch.validity > 0
        difference = (inputs.prediction.depth.float() - batch.sparse_depth.float()).abs()
        total = torch.where(valid, difference, 0.0).sum(dim=(1, 2, 3))
        return (total / valid.sum(dim=(1, 2, 3)).clamp(min=1)).mean()
