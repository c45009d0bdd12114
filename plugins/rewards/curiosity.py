"""Curiosity reward: the prediction error of a forward model that is learned in training."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from deux.contracts import Episode, Experience, Reward
from deux.environment.egocentric import egocentric_crop
from deux.environment.memory import MOVES
from deux.errors import check_range
from deux.geometry.poses import camera_pose

EDGE = 8.0  # metres of the map around the robot that the features are made of: all that a frame can change, and more
PIXELS = 16  # along that edge
KNOWN = 2  # free and occupied, the first two channels of a crop: an unknown map has features 0
WIDEST = 16_384  # features or hidden units: a gigabyte of weights


class CuriosityReward(Reward):
    """The squared error with which a forward model predicts the features of what is known next (Pathak et al. 2017).

    Features are a fixed random projection of the map around the robot, followed by a ReLU: Burda et al. (2019) find
    such features almost as good as learned ones, and unlike a policy's they stand still while the forward model
    learns. North is up in this map, not the heading, or turning on the spot would be the greatest surprise. The
    forward model predicts by how much the features change, from them, the heading and the action. It begins with no
    change at all and is trained once an episode on that episode's steps, with shuffled steps and Adam, as in
    exploring_exploration.

    Args:
        features: number of features.
        hidden: width of the forward model.
        learning_rate: of Adam; ten times the published one, since it learns from one environment only.
        learn: whether the forward model learns; without, two explorers are judged alike.
    """

    def __init__(self, features: int = 128, hidden: int = 256, learning_rate: float = 1e-3, learn: bool = True) -> None:
        for name, width in (("features", features), ("hidden", hidden)):
            check_range(f"curiosity's {name}", width, 1, WIDEST)
        check_range("curiosity's learning_rate", learning_rate, 0.0, 1.0, ends=False)
        self._learn = learn
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)  # the features are the same wherever they are computed
            self._projection = torch.randn(features, KNOWN * PIXELS**2) / KNOWN**0.5 / PIXELS
            self._model = nn.Sequential(
                nn.Linear(features + 2 + len(MOVES), hidden), nn.LeakyReLU(0.2),
                nn.Linear(hidden, hidden), nn.LeakyReLU(0.2),
                nn.Linear(hidden, features),
            )  # fmt: skip
        for parameter in self._model[-1].parameters():
            nn.init.zeros_(parameter)
        self._length = 0
        self._inputs: list[Tensor] = []
        self._changes: list[Tensor] = []
        self._before: tuple[Tensor, Tensor] | None = None  # features and heading
        self._optimiser = torch.optim.Adam(self._model.parameters(), learning_rate)

    def reset(self, episode: Episode) -> None:
        """Learn from the episode before, and begin another; one that was broken off teaches nothing."""
        if self._learn and self._inputs and len(self._inputs) == self._length:
            self._train(torch.stack(self._inputs), torch.stack(self._changes), episode.seed)
        self._length = episode.steps
        self._inputs, self._changes, self._before = [], [], None

    @torch.no_grad()
    def __call__(self, experience: Experience) -> float:
        """The sum over the features of the squared error; 0 at the first look."""
        now, before = self._encode(experience), self._before
        self._before = now
        if before is None or experience.action is None:
            return 0.0
        asked = torch.cat([*before, torch.eye(len(MOVES))[experience.action]])
        change = now[0] - before[0]
        self._inputs.append(asked)
        self._changes.append(change)
        return float((self._model(asked) - change).square().sum())

    def state(self) -> dict[str, np.ndarray]:
        """The forward model's weights, as they are now."""
        return {name: value.numpy().copy() for name, value in self._model.state_dict().items()}

    def load_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Take up the forward model's weights."""
        self._model.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in state.items()})

    def _encode(self, experience: Experience) -> tuple[Tensor, Tensor]:
        """The features of the map around the robot, and the direction that it faces, each a vector."""
        pose, known = experience.observation.pose, experience.occupancy
        north = camera_pose(pose[0, 3], pose[1, 3], pose[2, 3], 0.0)
        crop = egocentric_crop(known, np.zeros(known.shape, bool), experience.frame, north, EDGE, PIXELS)
        flat = torch.from_numpy(crop[:KNOWN].ravel() / np.float32(255.0))
        return (self._projection @ flat).relu(), torch.from_numpy(pose[[0, 2], 2].astype(np.float32))

    def _train(self, inputs: Tensor, changes: Tensor, seed: int, batch: int = 64) -> None:
        order = torch.randperm(len(inputs), generator=torch.Generator().manual_seed(seed))
        for part in order.split(batch):
            self._optimiser.zero_grad()
            (self._model(inputs[part]) - changes[part]).square().sum(dim=1).mean().backward()
            self._optimiser.step()
