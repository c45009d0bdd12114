"""The five resolution levels of the encoders of all published depth models."""

from collections.abc import Sequence

import torch
from torch import Tensor

from deux.errors import DeuxError, check_range

LEVELS = 5

MOST_CHANNELS = 65_536
"""Greatest number of channels of a layer; a single convolution between two such layers would have 150 GB."""


def check_levels(levels: int = LEVELS, **filters: Sequence[int]) -> None:
    """Raise DeuxError unless each option has a valid number of channels for every level.

    Args:
        levels: number of levels.
        filters: the options, by their names.
    """
    for option, values in filters.items():
        if len(values) != levels:
            raise DeuxError(f"{option}={list(values)} has {len(values)} entries: it must have {levels}, one per level.")
        for value in values:
            check_channels(**{option: value})


def check_channels(**numbers: int) -> None:
    """Raise DeuxError if an option is not a valid number of channels."""
    for option, number in numbers.items():
        check_range(f"model.{option}", number, 1, MOST_CHANNELS)


def joined(image_features: Sequence[Tensor], depth_features: Sequence[Tensor]) -> list[Tensor]:
    """Concatenate the features of the image encoder and the depth encoder at each level (late fusion)."""
    return [torch.cat(pair, dim=1) for pair in zip(image_features, depth_features, strict=True)]


def sizes(features: Sequence[Tensor]) -> list[tuple[int, int]]:
    """(height, width) of each level of the decoder, from 1/16 of the size to 1/2."""
    return [(level.shape[2], level.shape[3]) for level in reversed(features[:-1])]
