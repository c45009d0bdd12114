"""Base class of the learned explorers: a trained policy that acts on the map of what the robot has seen."""

from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch

from deux.contracts import Action, Episode, Explorer, ExplorerMap, Need, Observation
from deux.environment.memory import MOVES, ExplorationMemory
from deux.mapping.recovery import Recovery
from deux.policies.policy_files import TrainedPolicy, load_policy, policy_identity


class LearnedExplorer(Explorer):
    """Maps what the sensor sees, and acts as a policy chooses from the map, or as the recovery does if it is stuck.

    The policy is shown every move that is really made, those of the recovery (`deux.mapping.recovery`) as well. A
    subclass names the reward that its policy is trained for and the file with the weights that ship with it.

    Args:
        weights: a policy file of `task=train_explorer`; None for the one that ships with the explorer.
        greedy: whether the likeliest action is taken. Otherwise actions are drawn, as they were in training.
    """

    reward: ClassVar[str]
    """Registered name of the reward that the policy is trained for."""

    shipped_weights: ClassVar[Path]
    """The policy file that is used unless another one is named."""

    needs = frozenset({Need.SENSOR_DEPTH})

    def __init__(self, weights: str | None = None, greedy: bool = False) -> None:
        self._weights = self.shipped_weights if weights is None else Path(weights).expanduser()
        self._greedy = greedy

    @cached_property
    def policy(self) -> TrainedPolicy:
        """The trained policy, read when it is first asked for.

        Raises:
            DeuxError: there is no such policy file, or it is none.
        """
        return load_policy(self._weights)

    def fingerprint(self) -> str:
        """The hash of the policy file.

        Raises:
            DeuxError: there is no such file.
        """
        return policy_identity(self._weights)

    def reset(self, episode: Episode) -> None:
        """Begin an episode; raises DeuxError as `policy` does."""
        self._rng = np.random.default_rng(episode.seed)
        # A policy may also turn on the spot for ever, without touching anything.
        self._recovery = Recovery(episode.robot, self._rng, most_confined=0)
        self._memory = ExplorationMemory(episode.camera, episode.robot, self.policy.crops, self.policy.resolution)

    def act(self, observation: Observation) -> Action:
        """Map the frame; then the recovery chooses if the robot is stuck, otherwise the policy."""
        assert observation.sensor_depth is not None
        self._memory.see(observation.sensor_depth, observation.pose, observation.collided)
        action = self._recovery.action(observation.pose, observation.collided)
        if action is None:
            action = self._ask_policy()
        self._memory.acted(action)
        return action

    @torch.inference_mode()
    def _ask_policy(self) -> Action:
        """The policy's move: the likeliest one if it is greedy, otherwise drawn by the probabilities."""
        view = {name: torch.from_numpy(part)[None] for name, part in self._memory.view().items()}
        view = {name: part / 255.0 if part.dtype == torch.uint8 else part for name, part in view.items()}
        probabilities = self.policy.network(view)[0].softmax(dim=0).double().numpy()
        if self._greedy:
            return MOVES[int(probabilities.argmax())]
        return MOVES[int(self._rng.choice(len(MOVES), p=probabilities / probabilities.sum()))]

    def map(self) -> ExplorerMap | None:
        """The map as it stands; None before the first step."""
        known = self._memory.occupancy
        return None if known.cells.size == 0 else ExplorerMap(known.frame, known.cells.copy())
