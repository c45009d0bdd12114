"""Consistency of the estimated relative poses with those of the way back (VOICED)."""

import torch
from torch import Tensor

from deux.contracts import LossInputs, LossNeed, LossTerm


class PoseConsistency(LossTerm):
    """Mean square of T_ab T_ba - I over its 16 entries and the batch, summed over the source frames.

    T_ab carries points of the target camera a into the source camera b, T_ba carries them back. The robot's own poses
    are exact inverses and cost nothing: the term teaches a pose network (`pose=learned`). Rotation (no unit) and
    translation (metres) enter alike, as published.
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
