"""The kinds of plugins, and plugins as they are known before they are imported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Kind:
    """One kind of plugin.

    Args:
        name: the registry's name of the kind; its entry-point group is "deux.<name>".
        noun: what messages call a plugin of the kind.
        contract: the base class of its plugins, in `deux.contracts`.
        settings: path of a plugin's options in the configuration; "{name}" stands for the plugin's name.
        given: constructor parameters that the framework passes; all others are options.
        common: options that every plugin of the kind must have, because the configuration files of deux set them.
        reserved: options at that path that belong to the framework, besides "name"; no plugin may use these names.
        declared: attributes that must be frozensets, each with the type of the elements: a class in `deux.contracts`,
            or "str".
        attributes: attributes that every instance must have.
        ascending: two of these that must be numbers, the first 0 or more and less than the second.
    """

    name: str
    noun: str
    contract: str
    settings: str
    given: tuple[str, ...] = ()
    common: tuple[str, ...] = ()
    reserved: tuple[str, ...] = ()
    declared: tuple[tuple[str, str], ...] = ()
    attributes: tuple[str, ...] = ()
    ascending: tuple[str, str] | None = None

    @property
    def group(self) -> str:
        """The entry-point group."""
        return f"deux.{self.name}"


KINDS = {
    kind.name: kind
    for kind in (
        Kind("explorers", "explorer", "Explorer", "explore", declared=(("needs", "Need"),)),
        Kind(
            "depth_models",
            "depth model",
            "DepthModel",
            "model",
            attributes=("min_depth", "max_depth"),
            ascending=("min_depth", "max_depth"),
        ),
        Kind("rewards", "reward", "Reward", "explorer_training.reward_options", declared=(("needs", "Need"),)),
        Kind(
            "losses",
            "loss term",
            "LossTerm",
            "objective.{name}",
            reserved=("weight",),
            declared=(("needs", "LossNeed"), ("extras", "str")),
        ),
        Kind("uncertainties", "measure of uncertainty", "Uncertainty", "collect.uncertainty_options"),
        Kind(
            "simulators",
            "simulator",
            "Simulator",
            "simulator",
            given=("scene", "camera", "robot", "colors"),
            attributes=("scene", "camera", "robot", "label_names", "floors"),
        ),
        Kind("scenes", "source of scenes", "SceneSource", "scenes", common=("train", "validation", "test")),
        Kind("readers", "reader", "Reader", "data", given=("folder",), reserved=("cache",), attributes=("folder",)),
    )
}


GROUPS = (*(kind.group for kind in KINDS.values()), "deux.conf", "deux.weights")
"""The entry-point groups of deux; the last two are for configuration files and trained models."""


@dataclass(frozen=True)
class Plugin:
    """A plugin and the package that provides it. Nothing is imported until `load` is called.

    Args:
        name: its registered name.
        kind: a key of `KINDS`.
        package: name of the distribution.
        version: version of the distribution.
        target: "module:attribute".
        load: imports and returns the target.
    """

    name: str
    kind: str
    package: str
    version: str
    target: str
    load: Callable[[], Any] = field(repr=False, compare=False)

    @property
    def origin(self) -> str:
        """Package, version and target, for messages."""
        return f"{self.package} {self.version} ({self.target})"

    @property
    def called(self) -> str:
        """What messages call it: kind, name and origin."""
        return f"the {KINDS[self.kind].noun} {self.name!r} of {self.origin}"
