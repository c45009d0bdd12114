"""What made a run: its model, explorer and seed, the frames and the budget of its training, and its test frames.

Two numbers may stand in one table only if their runs differ in nothing but the model, the explorer and the seed. The
lists below say which options each of these parts is made of; no number depends on any other option, so that options
which a later version adds separate no runs until they are added here.
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
"""Options as sorted pairs of dotted key and JSON value; null and empty values are left out, as older runs lack them."""

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
"""What a depth model is made of: its own options, what it is built on, and how it is optimised."""

EXPLORER = ("explore", "callbacks")
"""What an explorer is made of: its own options and its rounds."""

GUIDANCE = (
    "seed_model",
    "collect.uncertainty",
    "collect.uncertainty_options",
    "collect.correct_depth",
    "collect.remembered_frames",
    "collect.batch_size",
)
"""What an explorer that a depth model guides is made of, too: that model, how it is judged, and what is mapped."""

CAMERA_AND_SCENES = ("camera", "robot", "simulator", "sampling", "verification", "scenes")
"""What all frames are made of; of `scenes`, each split belongs to the frames of that split only."""

TRAINING_FRAMES = (*CAMERA_AND_SCENES, "scenes.train", "collect.steps", "collect.episodes", "training.crop")
"""What the training frames are made of, beside the explorer."""

TEST_FRAMES = (*CAMERA_AND_SCENES, "scenes.test", "evaluation.viewpoints", "training.crop")
"""What the test frames are made of: free viewpoints of the test scenes."""

RECORDED_TEST_FRAMES = ("evaluation.data", "data", "camera.min_depth", "camera.max_depth", "training.crop")
"""What test frames are made of that were recorded before."""

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
"""What the budget is made of, which does not depend on the scenes: how much is explored, and how long is trained."""

UNUSED = {
    "training.steps": ("training.epochs",),
    "seed_model.checkpoint": ("seed_model.explore", "seed_model.steps", "seed_model.source", "seed_model.scenes"),
}
"""Options that nothing depends on where another one has a value."""

AS_BEFORE = {
    "collect.remembered_frames": "0",
    "explore.max_incidence": "90",
    "training.augmentation.scale": "[1, 1]",
    "training.averaging": "0",
    "training.betas": "[0.9, 0.999]",
    "training.compile": "false",
    "training.tf32": "false",
}
"""Options that a later version added, with the values by which it does what was done before, and which do no more where
they are written out. They are left out as null ones are, so that a sweep over two versions has one row."""

DRAW = "scenes.draw"
"""The option of generated scenes that says which ones a seed takes."""

DRAWN_BY_SEED = (DRAW, '"seed"')
"""What conditions say in place of the number of the draw where it is the seed, so that seeds stand in one table."""

_SPLITS = ("scenes.train", "scenes.validation", "scenes.test")
_OPTIONAL_SECTIONS = ("callbacks",)
"""Sections that are empty unless something was chosen."""


@dataclass(frozen=True)
class Conditions:
    """A run's configuration, taken apart.

    Args:
        model: name of the depth model.
        model_options: what else makes the model, see `MODEL`.
        explorer: name of the explorer that collected the training frames; None if they were given.
        explorer_options: what else makes the explorer, see `EXPLORER` and `GUIDANCE`.
        seed: the random seed.
        training_frames: what makes the training frames, see `TRAINING_FRAMES`.
        budget: see `BUDGET`.
        testing: what makes the test frames, see `TEST_FRAMES` and `RECORDED_TEST_FRAMES`.
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
        """The training frames and the budget: what must be equal for two models to be compared."""
        return tuple(sorted({*self.training_frames, *self.budget}))


def conditions(configuration: Mapping[str, Any], seed: int | None = None, overrides: Iterable[str] = ()) -> Conditions:
    """Take a run's configuration apart, of whatever version it is.

    Args:
        configuration: all of it, as `run.json` holds it.
        seed: of the run that trained the model, where this one only evaluates it; None for the configuration's own.
        overrides: of the run's command: a draw of scenes that it names is that one, though it may equal the seed.
    """
    configuration = current_keys(configuration)
    options = flatten_options(configuration)
    values = dict(options)
    options = tuple(one for one in options if AS_BEFORE.get(one[0]) != one[1] and _is_used(one[0], values))
    own_seed = int(configuration.get("seed", 0))
    by_seed = DRAW, json.dumps(own_seed if seed is None else seed)
    if not any(override.lstrip("+").startswith(f"{DRAW}=") for override in overrides):
        options = tuple(DRAWN_BY_SEED if option == by_seed else option for option in options)
    # An experiment tests on views of its scenes, whatever is named there.
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
    """Whether test frames differ in more than how many there are and what is cut out of them."""
    alike = ("evaluation.viewpoints", "training.crop")
    return {option for option in testing if option[0] not in alike} != {one for one in own if one[0] not in alike}


def flatten_options(options: Any, where: str = "") -> FlatOptions:
    """Nested options as sorted pairs.

    Example:
        >>> flatten_options({"camera": {"width": 64.0, "name": None}, "robot": {}, "pose": "simulator"})
        (('camera.width', '64'), ('pose', '"simulator"'))
    """
    return tuple(sorted(_flatten(options, where)))


def differences(mine: FlatOptions, others: FlatOptions) -> str:
    """What of `mine` is not in `others`, and what is only there: "camera.width=64, robot.radius not set"."""
    here, there = dict(mine), dict(others)
    words = [f"{key}={_unquoted(value)}" for key, value in mine if there.get(key) != value]
    words += [f"{key} not set" for key in there if key not in here]
    return ", ".join(words)


def variant_labels(
    choices: Iterable[FlatOptions], presets: Mapping[str, FlatOptions] | None = None
) -> dict[FlatOptions, str]:
    """A short label for each of several sets of options: what they differ in; "" where all are the same.

    Sets that hold all options of a preset are told from the others by its name alone. A section that some of them lack
    altogether is named as a whole: "with callbacks", "no callbacks".

    Args:
        choices: the sets.
        presets: named sets of options; a set that holds several of them counts to the largest.
    """
    largest_first = sorted((presets or {}).items(), key=lambda item: -len(item[1]))
    members: dict[str, list[FlatOptions]] = defaultdict(list)
    for choice in sorted(set(choices)):
        members[next((name for name, preset in largest_first if {*preset} <= {*choice}), "")].append(choice)
    return {
        choice: ", ".join(filter(None, (name, label)))
        for name, alike in members.items()
        for choice, label in _difference_labels(alike).items()
    }


def _difference_labels(distinct: Sequence[FlatOptions]) -> dict[FlatOptions, str]:
    keys = sorted({key for choice in distinct for key, _ in choice})
    sets = [dict(choice) for choice in distinct]
    differing = [key for key in keys if len({one.get(key) for one in sets if _is_used(key, one)}) > 1]
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
    """The options at or below some nodes, without the names of plugins and without the splits that are no node."""
    left_out = ("model.name", "explore.name", "data.cache", *(split for split in _SPLITS if split not in nodes))
    return tuple(
        (key, value)
        for key, value in options
        if any(_is_below(key, node) for node in nodes) and not any(_is_below(key, node) for node in left_out)
    )


def _is_used(key: str, options: Mapping[str, str]) -> bool:
    """Whether something depends on an option beside these others, see `UNUSED`."""
    return not any(chosen in options and key in unused for chosen, unused in UNUSED.items())


def _has(options: FlatOptions, node: str) -> bool:
    return any(_is_below(key, node) for key, _ in options)


def _is_below(key: str, node: str) -> bool:
    return key == node or key.startswith(f"{node}.")


def _is_guided(configuration: Mapping[str, Any]) -> bool:
    """Whether the explorer needs a depth model; taken for granted of one that cannot be made here as it was."""
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
    """Whole numbers as int, so that 90 and 90.0 are the same."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_number(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _unquoted(value: str) -> str:
    """A JSON value as a reader expects it."""
    return value.strip('"')
