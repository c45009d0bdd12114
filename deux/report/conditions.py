"""The conditions of a run: options of model and explorer, seed, training frames, budget and test frames.

Two runs can be compared in one table only if they differ in nothing but model, explorer and seed. The lists below
assign options to the parts of the conditions. Options that are in no list do not affect results: an option that a later
version adds has to be added here to distinguish runs.
"""

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deux.collection.perception import needs_model
from deux.errors import DeuxError
from deux.registry import registry
from deux.report.older_configurations import current_keys

FlatOptions = tuple[tuple[str, str], ...]
"""Options as sorted pairs of dotted key and JSON value; without null and empty values, which older runs lack."""

MODEL = (
    "model",
    "objective",
    "pose",
    "foundation",
    "training.batch_size",
    "training.learning_rate",
    "training.boundaries",
    "training.factors",
    "training.unit",
    "training.warmup_steps",
    "training.tf32",
    "training.compile",
    "training.sources",
    "training.offsets",
    "training.averaging",
    "training.betas",
    "training.supervised",
    "training.augmentation",
    "training.start",
    "trainer.precision",
    "trainer.accumulate_grad_batches",
    "trainer.gradient_clip_val",
    "trainer.gradient_clip_algorithm",
    "trainer.sync_batchnorm",
)
"""Options of a depth model: its own, those of its foundation, and those of its optimisation."""

EXPLORER = ("explore", "callbacks")
"""Options of an explorer: its own, and those of rounds of active collection."""

GUIDANCE = (
    "seed_model",
    "collect.uncertainty",
    "collect.uncertainty_options",
    "collect.correct_depth",
    "collect.remembered_frames",
    "collect.batch_size",
)
"""Additional options of an explorer that a depth model guides: seed model, uncertainty and mapped depth."""

CAMERA_AND_SCENES = ("camera", "robot", "simulator", "sampling", "verification", "scenes")
"""Options of all frames; of `scenes`, each split belongs to the frames of that split only."""

TRAINING_FRAMES = (*CAMERA_AND_SCENES, "scenes.train", "collect.steps", "collect.episodes", "training.crop")
"""Options of the training frames, besides those of the explorer."""

TEST_FRAMES = (*CAMERA_AND_SCENES, "scenes.test", "evaluation.viewpoints", "training.crop")
"""Options of test frames that are free viewpoints of the test scenes."""

RECORDED_TEST_FRAMES = ("evaluation.data", "data", "camera.min_depth", "camera.max_depth", "training.crop")
"""Options of recorded test frames."""

BUDGET = (
    "collect.steps",
    "collect.episodes",
    "camera.width",
    "camera.height",
    "training.crop",
    "training.steps",
    "training.epochs",
    "trainer.devices",
    "trainer.num_nodes",
    "trainer.max_steps",
    "trainer.max_epochs",
    "trainer.max_time",
    "trainer.min_steps",
    "trainer.min_epochs",
    "trainer.limit_train_batches",
    "trainer.overfit_batches",
    "trainer.fast_dev_run",
)
"""Options of the budget, which does not depend on the scenes: amount of exploration and length of training."""

UNUSED = {
    "training.steps": ("training.epochs",),
    "seed_model.checkpoint": ("seed_model.explore", "seed_model.steps", "seed_model.source", "seed_model.scenes"),
}
"""Options that have no effect if another option, the key, is set."""

EARLIER_BEHAVIOUR = {
    "collect.remembered_frames": "0",
    "explore.max_incidence": "90",
    "explore.view_guidance": "1",
    "explore.visited_is_free": "false",
    "training.augmentation.scale": "[1, 1]",
    "training.averaging": "0",
    "training.betas": "[0.9, 0.999]",
    "training.compile": "false",
    "training.tf32": "false",
}
"""Options added by later versions, with the values that reproduce the behaviour of earlier versions.

Like null values, these are left out, so that runs of a sweep from two versions are in one row.
"""

DRAW = "scenes.draw"
"""The option of generated scenes that selects them like a random seed."""

DRAWN_BY_SEED = (DRAW, '"seed"')
"""Replaces the value of `DRAW` if it equals the run's seed, so that runs with different seeds can be compared."""

_SPLITS = ("scenes.train", "scenes.validation", "scenes.test")
_OPTIONAL_SECTIONS = ("callbacks",)
"""Sections that are empty by default."""


@dataclass(frozen=True)
class Conditions:
    """The parts of a run's configuration that affect its results.

    Args:
        model: name of the depth model.
        model_options: options of the model, see `MODEL`.
        explorer: name of the explorer that collected the training frames; None for recorded frames.
        explorer_options: options of the explorer, see `EXPLORER` and `GUIDANCE`.
        seed: the random seed.
        training_frames: options of the training frames, see `TRAINING_FRAMES`.
        budget: options of the budget, see `BUDGET`.
        testing: options of the test frames, see `TEST_FRAMES` and `RECORDED_TEST_FRAMES`.
    """

    model: str
    model_options: FlatOptions
    explorer: str | None
    explorer_options: FlatOptions
    seed: int
    training_frames: FlatOptions
    budget: FlatOptions
    testing: FlatOptions

    @property
    def training(self) -> FlatOptions:
        """Options of training frames and budget, which must be equal for two runs to be compared."""
        return tuple(sorted({*self.training_frames, *self.budget}))


def conditions(configuration: Mapping[str, Any], seed: int | None = None, overrides: Iterable[str] = ()) -> Conditions:
    """The conditions of a run, from its configuration of any version.

    Args:
        configuration: the whole configuration, as in `run.json`.
        seed: seed of the run that trained the model, if this run only evaluates it; None for the configuration's seed.
        overrides: overrides of the run's command; an override of `DRAW` is not replaced by `DRAWN_BY_SEED`.
    """
    configuration = current_keys(configuration)
    options = flatten_options(configuration)
    values = dict(options)
    options = tuple(
        (key, value) for key, value in options if EARLIER_BEHAVIOUR.get(key) != value and _is_used(key, values)
    )
    own_seed = int(configuration.get("seed", 0))
    by_seed = DRAW, json.dumps(own_seed if seed is None else seed)
    if not any(override.lstrip("+").startswith(f"{DRAW}=") for override in overrides):
        options = tuple(DRAWN_BY_SEED if option == by_seed else option for option in options)
    # An experiment tests on its own scenes; only an evaluation uses evaluation.data.
    recorded = configuration.get("task") != "experiment" and bool((configuration.get("evaluation") or {}).get("data"))
    return Conditions(
        model=_name(configuration, "model"),
        model_options=_part(options, MODEL),
        explorer=None if configuration.get("training_data") else _name(configuration, "explore"),
        explorer_options=_part(options, (*EXPLORER, *GUIDANCE) if _is_guided(configuration) else EXPLORER),
        seed=own_seed,
        training_frames=_part(options, TRAINING_FRAMES),
        budget=_part(options, BUDGET),
        testing=_part(options, RECORDED_TEST_FRAMES if recorded else TEST_FRAMES),
    )


def other_scenes(testing: FlatOptions, own: FlatOptions) -> bool:
    """Whether two sets of test frames differ in more than their number and the crop."""
    ignored = ("evaluation.viewpoints", "training.crop")
    first, second = ({option for option in options if option[0] not in ignored} for options in (testing, own))
    return first != second


def flatten_options(options: Any, where: str = "") -> FlatOptions:
    """Nested options as sorted pairs.

    Example:
        >>> flatten_options({"camera": {"width": 64.0, "name": None}, "robot": {}, "pose": "simulator"})
        (('camera.width', '64'), ('pose', '"simulator"'))
    """
    return tuple(sorted(_flatten(options, where)))


def differences(options: FlatOptions, others: FlatOptions) -> str:
    """How options differ from others, as "camera.width=64, robot.radius not set"."""
    values, other_values = dict(options), dict(others)
    parts = [f"{key}={_unquoted(value)}" for key, value in options if other_values.get(key) != value]
    parts += [f"{key} not set" for key in other_values if key not in values]
    return ", ".join(parts)


def variant_labels(
    choices: Iterable[FlatOptions], presets: Mapping[str, FlatOptions] | None = None
) -> dict[FlatOptions, str]:
    """Short labels of several sets of options, made of what they differ in; "" if all sets are equal.

    Sets that contain all options of a preset are labelled with its name, and compared with one another only. A section
    that some sets lack is labelled as a whole: "with callbacks", "no callbacks".

    Args:
        choices: the sets.
        presets: named sets of options; of several that match, the largest is used.
    """
    largest_first = sorted((presets or {}).items(), key=lambda item: -len(item[1]))
    members: dict[str, list[FlatOptions]] = defaultdict(list)
    for choice in sorted(set(choices)):
        members[next((name for name, preset in largest_first if {*preset} <= {*choice}), "")].append(choice)
    return {
        choice: ", ".join(filter(None, (name, label)))
        for name, matching in members.items()
        for choice, label in _difference_labels(matching).items()
    }


def _difference_labels(distinct: Sequence[FlatOptions]) -> dict[FlatOptions, str]:
    keys = sorted({key for choice in distinct for key, _ in choice})
    sets = [dict(choice) for choice in distinct]
    differing = [key for key in keys if len({values.get(key) for values in sets if _is_used(key, values)}) > 1]
    optional = [node for node in _OPTIONAL_SECTIONS if len({_has(choice, node) for choice in distinct}) > 1]
    return {choice: ", ".join(_label(choice, differing, optional)) for choice in distinct}


def _label(choice: FlatOptions, differing: Iterable[str], optional: Sequence[str]) -> Iterator[str]:
    for node in optional:
        yield f"{'with' if _has(choice, node) else 'no'} {node}"
    values = dict(choice)
    for key in differing:
        if not any(_is_below(key, node) for node in optional) and _is_used(key, values):
            short = key.removeprefix("explore.").removeprefix("model.").removeprefix("collect.")
            yield f"{short}={_unquoted(values[key])}" if key in values else f"{short} not set"


def _part(options: FlatOptions, nodes: Sequence[str]) -> FlatOptions:
    """The options at or below some nodes, without names of plugins, and without splits that are not among the nodes."""
    left_out = ("model.name", "explore.name", "data.cache", *(split for split in _SPLITS if split not in nodes))
    return tuple(
        (key, value)
        for key, value in options
        if any(_is_below(key, node) for node in nodes) and not any(_is_below(key, node) for node in left_out)
    )


def _is_used(key: str, options: Mapping[str, str]) -> bool:
    """Whether an option has an effect, given the other options; see `UNUSED`."""
    return not any(other in options and key in unused for other, unused in UNUSED.items())


def _has(options: FlatOptions, node: str) -> bool:
    return any(_is_below(key, node) for key, _ in options)


def _is_below(key: str, node: str) -> bool:
    return key == node or key.startswith(f"{node}.")


def _is_guided(configuration: Mapping[str, Any]) -> bool:
    """Whether the explorer needs a depth model; True for an explorer that cannot be created in this installation."""
    explore = configuration.get("explore") or {}
    try:
        return needs_model(registry().choose("explorers", explore))
    except DeuxError:
        return True


def _name(configuration: Mapping[str, Any], node: str) -> str:
    return str((configuration.get(node) or {}).get("name", "unknown"))


def _flatten(value: Any, where: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flatten(item, f"{where}.{key}" if where else str(key))
    elif value is not None and value != []:
        yield where, json.dumps(_number(value), sort_keys=True)


def _number(value: Any) -> Any:
    """Convert whole floats to int, so that 90 and 90.0 are equal."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_number(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _unquoted(value: str) -> str:
    """A JSON value without quotes, for labels."""
    return value.strip('"')
