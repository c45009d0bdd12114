"""Base class of explorers with a trained policy."""

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
    """Explorer that maps the sensor depth and chooses actions by a trained policy, or by the recovery when stuck.

    The policy observes all executed actions, including those of the recovery (`deux.mapping.recovery`). Subclasses set
    the reward that the policy is trained for and the file of its shipped weights.

    Args:
        weights: policy file of `task=train_explorer`; None for the shipped one.
        greedy: choose the most probable action instead of sampling, as in training.
    """

    reward: ClassVar[str]
    """Registered name of the reward that the policy is trained for."""

    shipped_weights: ClassVar[Path]
    """The default policy file."""

    needs = frozenset({Need.SENSOR_DEPTH})

    def __init__(self, weights: str | None = None, greedy: bool = False) -> None:
        self._weights = self.shipped_weights if weights is None else Path(weights).expanduser()
        self._greedy = greedy

    @cached_property
    def policy(self) -> TrainedPolicy:
        """The trained policy, loaded on first use.

        Raises:
            DeuxError: the policy file is missing or damaged.
        """
        return load_policy(self._weights)

    def fingerprint(self) -> str:
        """Hash of the policy file.

        Raises:
            DeuxError: the policy file is missing.
        """
        return policy_identity(self._weights)

    def reset(self, episode: Episode) -> None:
        """Begin an episode; raises DeuxError if the policy cannot be loaded."""
        self._rng = np.random.default_rng(episode.seed)
        # A policy may also turn in place forever, without any collision.
        self._recovery = Recovery(episode.robot, self._rng, most_confined=0)
        self._memory = ExplorationMemory(episode.camera, episode.robot, self.policy.crops, self.policy.resolution)

    def act(self, observation: Observation) -> Action:
        """Add the frame to the map and return the action of the policy, or of the recovery if the robot is stuck."""
        assert observation.sensor_depth is not None
        self._memory.see(observation.sensor_depth, observation.pose, observation.collided)
        action = self._recovery.action(observation.pose, observation.collided)
        if action is None:
            action = self._ask_policy()
        self._memory.acted(action)
        return action

    @torch.inference_mode()
    def _ask_policy(self) -> Action:
        """The policy's action: the most probable one if `greedy`, otherwise sampled."""
        view = {name: torch.from_numpy(part)[None] for name, part in self._memory.view().items()}
        view = {name: part / 255.0 if part.dtype == torch.uint8 else part for name, part in view.items()}
        probabilities = self.policy.network(view)[0].softmax(dim=0).double().numpy()
        if self._greedy:
            return MOVES[int(probabilities.argmax())]
        return MOVES[int(self._rng.choice(len(MOVES), p=probabilities / probabilities.sum()))]

    def map(self) -> ExplorerMap | None:
        """The current map; None before the first step."""
        known = self._memory.occupancy
        return None if known.cells.size == 0 else ExplorerMap(known.frame, known.cells.copy())
