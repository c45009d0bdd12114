"""Which explorers take part in a comparison, and by which rewards they are judged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from deux.collection.perception import MODEL_NEEDS
from deux.collection.specification import fingerprint_of
from deux.contracts import NO_ROBOT, Explorer, FreeViewpoints, Reward
from deux.errors import DeuxError, printable
from deux.policies.learned_explorer import LearnedExplorer
from deux.registry import PluginChoice, registry

RewardStates = Mapping[str, Mapping[str, np.ndarray]]
"""What each reward has learned, by the reward's registered name; empty for most."""


@dataclass
class Participants:
    """The explorers and the rewards of one comparison.

    Args:
        explorers: with their options.
        fingerprints: `Explorer.fingerprint` of each, by name.
        own_rewards: the reward that a learned explorer was trained for, by the explorer's name.
        rewards: the rewards that judge all of them.
        left_out: why each explorer or reward that is installed does not take part, by name.
    """

    explorers: list[PluginChoice] = field(default_factory=list)
    fingerprints: dict[str, str | None] = field(default_factory=dict)
    own_rewards: dict[str, str] = field(default_factory=dict)
    rewards: dict[str, Mapping[str, np.ndarray]] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)

    @property
    def identity(self) -> dict[str, Any]:
        """What the episodes depend on besides the configuration."""
        return {choice.name: {**choice.settings, "is": self.fingerprints[choice.name]} for choice in self.explorers}


def find_participants(named: Sequence[str] | None, configured: PluginChoice, has_model: bool) -> Participants:
    """The explorers that are named, or all installed ones that can take part.

    A reward that learns judges by what it learned while the compared explorer that seeks it was trained, and where
    none seeks it, it does not judge.

    Args:
        named: registered names (`compare.explorers`); None for all that are installed.
        configured: the explorer of `explore`, which keeps its options; the others have their defaults.
        has_model: whether there is a depth model for explorers that need one.

    Raises:
        DeuxError: an explorer that is named cannot take part, or none can.
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
                raise DeuxError(
                    f"{name} needs a depth model: name a trained one with seed_model.checkpoint=, such as kbnet-indoor."
                )
            if isinstance(explorer, LearnedExplorer):
                learned.setdefault(explorer.reward, explorer.policy.reward_state)
                found.own_rewards[name] = explorer.reward
            found.explorers.append(choice)
        except DeuxError as error:
            if named:
                raise
            found.left_out[name] = str(error)
        except (Exception, SystemExit) as error:  # the modules and constructors of other packages may raise anything
            if named or name == configured.name:
                raise
            found.left_out[name] = _unmade(name, error)
    if not found.explorers:
        raise DeuxError(f"there is no explorer to compare: {' '.join(found.left_out.values())}")
    for name in registry().names("rewards"):
        state = learned.get(name, {})
        try:
            if state or not registry().create("rewards", name, {}).state():
                found.rewards[name] = state
        except (Exception, SystemExit) as error:
            found.left_out[f"the reward {name}"] = _unmade(name, error)
    return found


def _unmade(name: str, error: BaseException) -> str:
    if isinstance(error, DeuxError):
        return str(error)
    return f"{name} cannot be made: {type(error).__name__}: {printable(str(error))}."


def make_rewards(states: RewardStates) -> dict[str, Reward]:
    """New rewards, none of which learns from an episode before: all explorers are judged alike."""
    rewards: dict[str, Reward] = {name: registry().create("rewards", name, {}) for name in states}
    for name, reward in rewards.items():
        if states[name]:
            reward.load_state(states[name])
    return rewards
