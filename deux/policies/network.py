"""The network of the learned explorers: two crops of the map and the body in, what to do next out."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from deux.environment.egocentric import CHANNELS
from deux.environment.memory import MOVES

FEATURES = 128


class MapEncoder(nn.Module):
    """One small convolutional network for each crop; their outputs and the body's numbers become 128 features.

    Its input are maps, and they remember where the robot has been, so it needs no recurrent state.

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
        """From "near" and "far", N x 4 x pixels x pixels in [0, 1], and "body", N x 4, to N x 128."""
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
    """The encoder and a linear layer over it: the part of a trained policy that chooses.

    Args:
        pixels: edge of the crops in pixels.
    """

    def __init__(self, pixels: int) -> None:
        super().__init__()
        self.encoder = MapEncoder(pixels)
        self.action = nn.Linear(FEATURES, len(MOVES))

    def forward(self, view: Mapping[str, Tensor]) -> Tensor:
        """The logarithms of the moves' relative probabilities, N x 3."""
        logits: Tensor = self.action(self.encoder(view))
        return logits
