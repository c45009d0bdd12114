"""Curiosity reward: the prediction error of a forward model that is learned during training."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from deux.contracts import Episode, Experience, Reward
from deux.environment.egocentric import egocentric_crop
from deux.environment.memory import MOVES
from deux.errors import check_range
from deux.geometry.poses import camera_pose

EDGE = 8.0  # metres; edge of the map crop around the robot, larger than the part that a frame can change
PIXELS = 16  # edge of the crop in pixels
KNOWN = 2  # channels of the crop: free and occupied, so that the features of an unknown map are 0
WIDEST = 16_384  # greatest number of features or hidden units: a gigabyte of weights


class CuriosityReward(Reward):
    """The squared error of a forward model that predicts the features of the next map (Pathak et al. 2017).

    Features are a fixed random projection of the map around the robot, followed by a ReLU. Burda et al. (2019) find
    such features almost as good as learned ones, and they do not change while the forward model learns. The map is
    north-up rather than heading-up, because otherwise turning in place would have the largest error. The forward model
    predicts the change of the features from the features, the heading and the action. Its initial prediction is no
    change, and it is trained after each episode on the shuffled steps of the episode with Adam, as in
    exploring_exploration.

    Args:
        features: number of features.
        hidden: width of the forward model.
        learning_rate: learning rate of Adam; ten times the published one, because there is only one environment.
        learn: whether the forward model learns; if not, the rewards of two explorers are comparable.
    """

    def __init__(self, features: int = 128, hidden: int = 256, learning_rate: float = 1e-3, learn: bool = True) -> None:
        for name, width in (("features", features), ("hidden", hidden)):
            check_range(f"curiosity's {name}", width, 1, WIDEST)
        check_range("curiosity's learning_rate", learning_rate, 0.0, 1.0, ends=False)
        self._learn = learn
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)  # the same features in every process
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
        """Train on the previous episode unless it was aborted, and begin another."""
        if self._learn and self._inputs and len(self._inputs) == self._length:
            self._train(torch.stack(self._inputs), torch.stack(self._changes), episode.seed)
        self._length = episode.steps
        self._inputs, self._changes, self._before = [], [], None

    @torch.no_grad()
    def __call__(self, experience: Experience) -> float:
        """The sum of the squared error over the features; 0 in the first step."""
        now, before = self._encode(experience), self._before
        self._before = now
        if before is None or experience.action is None:
            return 0.0
        inputs = torch.cat([*before, torch.eye(len(MOVES))[experience.action]])
        change = now[0] - before[0]
        self._inputs.append(inputs)
        self._changes.append(change)
        return float((self._model(inputs) - change).square().sum())

    def state(self) -> dict[str, np.ndarray]:
        """A copy of the forward model's weights."""
        return {name: value.numpy().copy() for name, value in self._model.state_dict().items()}

    def load_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Load the forward model's weights."""
        self._model.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in state.items()})

    def _encode(self, experience: Experience) -> tuple[Tensor, Tensor]:
        """The features of the map around the robot, and the robot's heading as a 2D vector."""
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
