"""What made a run, taken apart: which model, which explorer, which seed, trained on what and tested on what.

Two numbers may stand in one table only if their runs differ in nothing but the model, the explorer and the seed. So a
run's configuration is split into facts about each of them, and runs are compared by these.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Facts = tuple[tuple[str, str], ...]
"""Options and their values as JSON, sorted; those that are null or empty are left out, as older runs lack them."""

_SEEN = ("camera", "robot", "renderer", "sampling", "verification")
"""What both the training frames and the test frames depend on."""

_NO_CONDITION = (
    "hydra",
    "paths",
    "report",
    "task",
    "random_seed",
    "evaluation",
    "checkpoint",
    "image",
    "sparse",
    "sparse_scale",
    "intrinsics",
    "ground_truth",
    "export",
    "explorer_training",
    "compare",
    "collect.processes",
    "training.num_workers",
    "training.validations",
    "trainer.accelerator",
    "trainer.devices",
    "model.name",
    "explore.name",
    "scenes.validation",
)
"""What no number of an experiment depends on, or what is known otherwise."""

_EXPLORER = ("explore", "seed", "collect.uncertainty", "callbacks")
"""What makes an explorer beside its name: its options, the model that guides it and how that is judged, its rounds."""

_OPTIONAL = ("callbacks",)
"""Nodes that are there only if they were chosen."""

_BUDGET = ("collect", "training", "camera.width", "camera.height")


@dataclass(frozen=True)
class Conditions:
    """A run's configuration, taken apart.

    Args:
        model: name of the depth model.
        model_options: what else makes the model: its options, objective, foundation, learning rate.
        explorer: name of the explorer that collected the training frames; None if they were given.
        explorer_options: what else makes the explorer: its options, its seed model and how that is judged, its rounds.
        seed: the random seed.
        training: the training frames and the budget.
        testing: the test frames.
    """

    model: str
    model_options: Facts
    explorer: str | None
    explorer_options: Facts
    seed: int
    training: Facts
    testing: Facts

    @property
    def budget(self) -> Facts:
        """Those facts of the training that do not depend on the scenes."""
        return _below(self.training, _BUDGET)


def conditions(identity: Mapping[str, Any]) -> Conditions:
    """Take a run's identity apart; options that an older run does not have are taken for null.

    Args:
        identity: the whole configuration, as `run.json` holds it.
    """
    everything = tuple(fact for fact in facts(identity) if not _is_below(fact[0], _NO_CONDITION))
    training = dict(_below(everything, ("training.steps", "training.epochs")))
    if "training.steps" in training:
        training.pop("training.epochs", None)  # not used then
    model_parts = ("model", "objective", "pose", "foundation", "training")
    no_schedule = ("training.steps", "training.epochs", "training.crop")
    model = tuple(fact for fact in _below(everything, model_parts) if not _is_below(fact[0], no_schedule))
    explorer = _below(everything, _EXPLORER)
    elsewhere = (*model_parts, *_EXPLORER, "scenes.test")
    training |= {key: value for key, value in everything if not _is_below(key, elsewhere)}
    training |= dict(_below(everything, ("training.crop",)))
    return Conditions(
        model=_name(identity, "model"),
        model_options=model,
        explorer=None if identity.get("training_data") else _name(identity, "explore"),
        explorer_options=explorer,
        seed=int(identity.get("random_seed", 0)),
        training=tuple(sorted(training.items())),
        testing=_testing(identity, everything),
    )


def facts(options: Any, where: str = "") -> Facts:
    """Nested options as sorted facts.

    Example:
        >>> facts({"camera": {"width": 64.0, "name": None}, "robot": {}, "pose": "simulator"})
        (('camera.width', '64'), ('pose', '"simulator"'))
    """
    return tuple(sorted(_flat(options, where)))


def differences(mine: Facts, others: Facts) -> str:
    """What of `mine` is not in `others`, and what is only there: "camera.width=64, robot.radius not set"."""
    here, there = dict(mine), dict(others)
    words = [f"{key}={_plain(value)}" for key, value in mine if there.get(key) != value]
    words += [f"{key} not set" for key in there if key not in here]
    return ", ".join(words)


def variants(choices: Iterable[Facts]) -> dict[Facts, str]:
    """A short name for each of several sets of facts, of what they differ in; "" where all are the same.

    A node that some of them lack altogether is named as a whole: "with callbacks", "no callbacks".
    """
    distinct = sorted(set(choices))
    keys = sorted({key for choice in distinct for key, _ in choice})
    differing = [key for key in keys if len({dict(choice).get(key) for choice in distinct}) > 1]
    optional = [node for node in _OPTIONAL if len({bool(_below(choice, (node,))) for choice in distinct}) > 1]
    return {choice: ", ".join(_words(choice, differing, optional)) for choice in distinct}


def _words(choice: Facts, differing: Iterable[str], optional: Sequence[str]) -> Iterator[str]:
    for node in optional:
        yield f"{'with' if _below(choice, (node,)) else 'no'} {node}"
    for key in differing:
        if not _is_below(key, optional):
            yield _variant(dict(choice), key)


def _variant(choice: Mapping[str, str], key: str) -> str:
    short = key.removeprefix("explore.").removeprefix("model.").removeprefix("collect.")
    return f"{short}={_plain(choice[key])}" if key in choice else f"{short} not set"


def _testing(identity: Mapping[str, Any], everything: Facts) -> Facts:
    """The facts of the test frames: recorded data where such are given, the scenes' free viewpoints otherwise."""
    evaluation = identity.get("evaluation") or {}
    if evaluation.get("data"):
        chosen = {"evaluation.data": evaluation["data"]}
        seen: tuple[str, ...] = ("camera.min_depth", "camera.max_depth", "training.crop")
    else:
        chosen = {"evaluation.viewpoints": evaluation.get("viewpoints")}
        seen = (*_SEEN, "scenes", "training.crop")
    kept = [fact for fact in _below(everything, seen) if fact[0] != "scenes.train"]
    return tuple(sorted({*kept, *facts(chosen)}))


def _name(identity: Mapping[str, Any], node: str) -> str:
    return str((identity.get(node) or {}).get("name", "unknown"))


def _flat(value: Any, where: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{where}.{key}" if where else str(key))
    elif value is not None and value != []:
        yield where, json.dumps(_number(value), sort_keys=True)


def _number(value: Any) -> Any:
    """Whole numbers as int, so that 90 and 90.0 are the same."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_number(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _plain(value: str) -> str:
    """A JSON value as a reader expects it."""
    return value.strip('"')


def _is_below(key: str, nodes: Iterable[str]) -> bool:
    return any(key == node or key.startswith(f"{node}.") for node in nodes)


def _below(chosen: Facts, nodes: Iterable[str]) -> Facts:
    nodes = tuple(nodes)
    return tuple(fact for fact in chosen if _is_below(fact[0], nodes))
