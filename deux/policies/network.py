"""Policy network of the learned explorers, which maps two map crops and the last action to the next action."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from deux.environment.egocentric import CHANNELS
from deux.environment.memory import MOVES

FEATURES = 128
"""Width of the encoder's output."""


class MapEncoder(nn.Module):
    """Encoder with a small convolutional network for each crop and a linear layer that joins them with "body".

    It has no recurrent state, since the maps contain the visited positions.

    Args:
        pixels: edge of the crops in pixels, a multiple of 8.
    """

    def __init__(self, pixels: int) -> None:
        super().__init__()
        self.near = _crop_network()
        self.far = _crop_network()
        joined = 2 * 32 * (pixels // 8) ** 2 + len(MOVES) + 1
        self.join = nn.Sequential(nn.Linear(joined, FEATURES), nn.ReLU())

    def forward(self, view: Mapping[str, Tensor]) -> Tensor:
        """Compute N x 128 features from "near" and "far", N x 4 x pixels x pixels in [0, 1], and "body", N x 4."""
        parts = [self.near(view["near"]), self.far(view["far"]), view["body"]]
        features: Tensor = self.join(torch.cat(parts, dim=1))
        return features


def _crop_network() -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(len(CHANNELS), 32, 4, stride=4), nn.ReLU(),
        nn.Conv2d(32, 32, 3, stride=2, padding=1), nn.ReLU(),
        nn.Flatten(),
    )  # fmt: skip


class PolicyNetwork(nn.Module):
    """Actor of a trained policy: the encoder and a linear layer for the logits of `MOVES`.

    Args:
        pixels: edge of the crops in pixels.
    """

    def __init__(self, pixels: int) -> None:
        super().__init__()
        self.encoder = MapEncoder(pixels)
        self.action = nn.Linear(FEATURES, len(MOVES))

    def forward(self, view: Mapping[str, Tensor]) -> Tensor:
        """Compute the logits of the moves, N x 3; the arguments are those of `MapEncoder`."""
        logits: Tensor = self.action(self.encoder(view))
        return logits
