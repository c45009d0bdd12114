"""The five levels of resolution that the encoders of all published depth models have."""

from collections.abc import Sequence

import torch
from torch import Tensor

from deux.errors import DeuxError

LEVELS = 5


def check_levels(**filters: Sequence[int]) -> None:
    """Raise DeuxError unless each option holds one number of channels for every level."""
    for option, values in filters.items():
        if len(values) != LEVELS:
            raise DeuxError(f"{option}={values} has {len(values)} entries: the network has {LEVELS} levels.")


def joined(image_features: Sequence[Tensor], depth_features: Sequence[Tensor]) -> list[Tensor]:
    """The features of an image and a depth encoder side by side at each level (late fusion)."""
    return [torch.cat(pair, dim=1) for pair in zip(image_features, depth_features, strict=True)]


def sizes(features: Sequence[Tensor]) -> list[tuple[int, int]]:
    """(height, width) of each level that a decoder comes to, from 1/16 of the size to 1/2."""
    return [(level.shape[2], level.shape[3]) for level in reversed(features[:-1])]
