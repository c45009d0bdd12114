"""Consistency of the estimated forward and backward relative poses (VOICED)."""

import torch
from torch import Tensor

from deux.contracts import LossInputs, LossNeed, LossTerm


class PoseConsistency(LossTerm):
    """Mean square of T_ab T_ba - I over its 16 entries and the batch, summed over the source frames.

    T_ab transforms points of the target camera a to the source camera b, T_ba transforms them back. The robot's own
    poses are exact inverses, so the term is zero for them; it trains a pose network (`pose=learned`). Rotation
    (unitless) and translation (metres) have equal weights, as published.
    """

    needs = frozenset({LossNeed.BACKWARD_POSES})

    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value."""
        reconstructions = inputs.reconstructions
        assert reconstructions is not None
        assert reconstructions.target_from_source is not None
        forward, backward = reconstructions.source_from_target.float(), reconstructions.target_from_source.float()
        there_and_back = forward @ backward
        identity = torch.eye(4, device=there_and_back.device)
        return (there_and_back - identity).square().mean(dim=(0, 2, 3)).sum()
