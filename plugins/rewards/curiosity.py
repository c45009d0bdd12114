"""Curiosity: what a model of the consequences of actions, learned along the way, did not foresee."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from deux.contracts import Episode, Experience, Reward
from deux.environment.memory import MOVES

POOLED = 8  # rows and columns that a crop is averaged to


class CuriosityReward(Reward):
    """The squared error with which a forward model predicts the features of what is seen next (Pathak et al. 2017).

    Features are a fixed random projection of the two crops of the map, followed by a ReLU: Burda et al. (2019) find
    such features almost as good as learned ones, and unlike a policy's they stand still while the forward model
    learns. The forward model is trained once an episode on that episode's steps, with shuffled steps and Adam, as in
    exploring_exploration.

    Args:
        features: number of features.
        hidden: width of the forward model.
        learning_rate: of Adam.
        learn: whether the forward model learns; without, two explorers are judged alike.
    """

    def __init__(self, features: int = 128, hidden: int = 256, learning_rate: float = 1e-4, learn: bool = True) -> None:
        self._learn = learn
        generator = torch.Generator().manual_seed(0)  # the features are the same wherever they are computed
        self._features = features
        self._projection = torch.empty(0)
        self._generator = generator
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)
            self._model = nn.Sequential(
                nn.Linear(features + len(MOVES), hidden), nn.LeakyReLU(0.2),
                nn.Linear(hidden, hidden), nn.LeakyReLU(0.2),
                nn.Linear(hidden, features),
            )  # fmt: skip
        self._length = 0
        self._inputs: list[Tensor] = []
        self._targets: list[Tensor] = []
        self._before: Tensor | None = None
        self._optimiser = torch.optim.Adam(self._model.parameters(), learning_rate)

    def reset(self, episode: Episode) -> None:
        """Learn from the episode before, and begin another; one that was broken off teaches nothing."""
        if self._learn and self._inputs and len(self._inputs) == self._length:
            self._train(torch.stack(self._inputs), torch.stack(self._targets), episode.seed)
        self._length = episode.steps
        self._inputs, self._targets, self._before = [], [], None

    @torch.no_grad()
    def __call__(self, experience: Experience) -> float:
        """The sum over the features of the squared error; 0 at the first look."""
        now, before = self._encode(experience.view), self._before
        self._before = now
        if before is None or experience.action is None:
            return 0.0
        asked = torch.cat([before, torch.eye(len(MOVES))[experience.action]])
        self._inputs.append(asked)
        self._targets.append(now)
        return float((self._model(asked) - now).square().sum())

    def state(self) -> dict[str, np.ndarray]:
        """The forward model's weights, as they are now."""
        return {name: value.numpy().copy() for name, value in self._model.state_dict().items()}

    def load_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Take up the forward model's weights."""
        self._model.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in state.items()})

    def _encode(self, view: Mapping[str, np.ndarray]) -> Tensor:
        """The features of the two crops, a vector."""
        crops = np.concatenate([view["near"], view["far"]])
        channels, size, _ = crops.shape
        blocks = crops.reshape(channels, POOLED, size // POOLED, POOLED, size // POOLED)
        flat = torch.from_numpy(blocks.mean(axis=(2, 4), dtype=np.float32).ravel() / 255.0)
        if self._projection.shape != (self._features, len(flat)):
            self._projection = torch.randn(self._features, len(flat), generator=self._generator.manual_seed(0))
            self._projection /= len(flat) ** 0.5
        return (self._projection @ flat).relu()

    def _train(self, inputs: Tensor, targets: Tensor, seed: int, batch: int = 64) -> None:
        order = torch.randperm(len(inputs), generator=torch.Generator().manual_seed(seed))
        for part in order.split(batch):
            self._optimiser.zero_grad()
            (self._model(inputs[part]) - targets[part]).square().sum(dim=1).mean().backward()
            self._optimiser.step()
