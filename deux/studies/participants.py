"""Selects the explorers and rewards of a comparison."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from deux.collection.perception import MODEL_NEEDS
from deux.collection.specification import fingerprint_of
from deux.contracts import NO_ROBOT, Explorer, FreeViewpoints, Reward
from deux.errors import DeuxError
from deux.plugin_failures import creation_failure
from deux.policies.learned_explorer import LearnedExplorer
from deux.registry import PluginChoice, registry

RewardStates = Mapping[str, Mapping[str, np.ndarray]]
"""The learned state of each reward, by its registered name; empty for rewards that do not learn."""


@dataclass
class Participants:
    """The explorers and rewards of one comparison.

    Args:
        explorers: explorers with their options.
        fingerprints: `Explorer.fingerprint` of each, by name.
        own_rewards: the reward that a learned explorer was trained with, by the explorer's name.
        rewards: states of the rewards that are computed for all explorers, by name.
        left_out: reasons why installed explorers or rewards do not take part, by name.
    """

    explorers: list[PluginChoice] = field(default_factory=list)
    fingerprints: dict[str, str | None] = field(default_factory=dict)
    own_rewards: dict[str, str] = field(default_factory=dict)
    rewards: dict[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)

    @property
    def identity(self) -> dict[str, Any]:
        """The part of the run's identity besides the configuration."""
        return {choice.name: {**choice.settings, "is": self.fingerprints[choice.name]} for choice in self.explorers}


def find_participants(named: Sequence[str] | None, configured: PluginChoice, has_model: bool) -> Participants:
    """Find the explorers and rewards of a comparison.

    A reward that learns is computed with the state from the training of a compared explorer with this reward; without
    such an explorer, it is left out.

    Args:
        named: names of explorers (`compare.explorers`); None for all installed explorers that can take part.
        configured: the explorer of the section `explore`, with its options; the others have their defaults.
        has_model: whether there is a depth model for explorers that need one.

    Raises:
        DeuxError: a named explorer cannot take part, or there is no explorer.
    """
    found = Participants()
    learned: dict[str, Mapping[str, np.ndarray]] = {}
    for name in dict.fromkeys(named or registry().names("explorers")):
        try:
            choice = configured
            if name != configured.name:
                choice = registry().choose("explorers", {"name": name}, "compare.explorers")
            explorer: Explorer = choice.create()
            if isinstance(explorer, FreeViewpoints):
                raise DeuxError(f"{name} cannot be compared: {NO_ROBOT}")
            found.fingerprints[name] = fingerprint_of(explorer)
            if explorer.needs & MODEL_NEEDS and not has_model:
                raise DeuxError(f"{name} needs a depth model: set seed_model.checkpoint= to one, such as kbnet-indoor.")
            if isinstance(explorer, LearnedExplorer):
                learned.setdefault(explorer.reward, explorer.policy.reward_state)
                found.own_rewards[name] = explorer.reward
            found.explorers.append(choice)
        except DeuxError as error:
            if named:
                raise
            found.left_out[name] = str(error)
        except (Exception, SystemExit) as error:  # third-party plugins may raise anything
            if named or name == configured.name:
                raise
            found.left_out[name] = creation_failure(name, error)
    if not found.explorers:
        raise DeuxError(f"there is no explorer to compare: {' '.join(found.left_out.values())}")
    for name in registry().names("rewards"):
        state = learned.get(name, {})
        try:
            if state or not registry().create("rewards", name, {}).state():
                found.rewards[name] = state
        except (Exception, SystemExit) as error:
            found.left_out[f"the reward {name}"] = creation_failure(name, error)
    return found


def make_rewards(states: RewardStates) -> dict[str, Reward]:
    """Create rewards with their learned states, independent of earlier episodes."""
    rewards: dict[str, Reward] = {name: registry().create("rewards", name, {}) for name in states}
    for name, reward in rewards.items():
        if states[name]:
            reward.load_state(states[name])
    return rewards
