"""A loss term that allows slanted surfaces and punishes bent ones."""

import torch
from torch import Tensor

from deux.contracts import LossInputs, LossTerm


class SecondOrderSmoothness(LossTerm):
    """Mean absolute second difference of the predicted depth in metres, weighted down at edges of the image.

    A pixel's weight is exp(-sharpness * |second difference of the image|), along each axis. Depth that
    changes at a constant rate costs nothing, unlike under a first-order term.

    Args:
        sharpness: how fast the weight falls with the image's edges.
    """

    def __init__(self, sharpness: float = 10.0) -> None:
        self.sharpness = sharpness

    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value, a float32 scalar."""
        depth, image = inputs.prediction.depth.float(), inputs.batch.image.float()
        terms = []
        for axis in (-1, -2):
            edges = torch.diff(image, n=2, dim=axis).abs().mean(dim=1, keepdim=True)
            terms.append((torch.exp(-self.sharpness * edges) * torch.diff(depth, n=2, dim=axis).abs()).mean())
        return torch.stack(terms).sum()
