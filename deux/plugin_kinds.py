"""The kinds of plugins, and what is known of a plugin before it is imported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Kind:
    """One kind of plugin.

    Args:
        name: the registry's name of the kind; its entry-point group is "deux.<name>".
        noun: how messages call one plugin of the kind.
        contract: the class in `deux.contracts` that a plugin derives from.
        settings: where the options of the plugin called {name} stand in the configuration.
        given: the constructor's parameters that the framework fills in; the others are options.
        common: options that every plugin of the kind has, which configuration files of deux set.
        reserved: options of the framework among the plugin's in the configuration, beside "name", which is one in those
            of every kind; no plugin has their names.
        declared: attributes of a plugin that hold frozensets, and of what: a class in `deux.contracts`, or "str".
        attributes: what else a plugin that was made has, which its class or its constructor sets.
        ascending: two of these that are numbers, the first 0 or more and below the second.
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
"""The entry-point groups of deux; the last two hold configuration files and trained models."""


@dataclass(frozen=True)
class Plugin:
    """A plugin and the package that brought it. Nothing is imported until `load` is called.

    Args:
        name: the name under which it is chosen.
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
        """How messages call it: kind, name and origin."""
        return f"the {KINDS[self.kind].noun} {self.name!r} of {self.origin}"
