"""The tasks, and reading of the sections of the configuration that they use.

A section is a top-level node of the configuration. Its options are defined by the dataclass or plugin that uses it. A
task reads and checks only the sections that it declares.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from omegaconf import DictConfig, OmegaConf

from deux.errors import DeuxError, near_matches, shown
from deux.options import construct
from deux.plain_settings import plain, plain_options, references_resolved
from deux.plugin_kinds import KINDS
from deux.registry import PluginChoice, registry

T = TypeVar("T")


class Task(NamedTuple):
    """A value of `task=`.

    Args:
        purpose: what the task does, for the help page.
        sections: the sections that it reads; they determine the name of the run folder.
    """

    purpose: str
    sections: tuple[str, ...]


_SCENES = ("simulator", "camera", "robot", "scenes")
_COLLECTION = (*_SCENES, "explore", "collect", "sampling", "verification")
_TRAINING = ("model", "objective", "pose", "training", "trainer", "foundation")
_MODEL_GUIDED = (*_COLLECTION, *_TRAINING, "seed_model", "evaluation", "seed")
"""Includes `evaluation`, which determines the number of validation frames of a training."""

TASKS = {
    "experiment": Task(
        "collect, train the seed model, explore with it, train the final model, evaluate",
        (*_MODEL_GUIDED, "callbacks"),
    ),
    "collect": Task("explore the training scenes and write the dataset", _MODEL_GUIDED),
    "train": Task(
        "train the depth model on the dataset, which is collected first if it does not exist",
        (*_MODEL_GUIDED, "callbacks", "data", "training_data"),
    ),
    "evaluate": Task("evaluate a trained model on the held-out scenes", (*_MODEL_GUIDED, "callbacks", "data")),
    "predict": Task("complete the depth of one or many frames from files", ("predict", "model", "camera", "data")),
    "train_explorer": Task(
        "train the policy of a learned explorer with PPO", (*_SCENES, "explore", "explorer_training", "seed")
    ),
    "compare_explorers": Task(
        "compare the explorers in unseen scenes",
        (*_SCENES, "explore", "collect", "sampling", "compare", "seed_model", "model", "trainer", "seed"),
    ),
    "study_uncertainty": Task(
        "measure how well uncertainty measures predict the depth model's errors in unseen scenes", _MODEL_GUIDED
    ),
    "export": Task(
        "export a trained model as an ONNX file, or for its authors' published code",
        ("export", "model", "camera"),
    ),
    "export_dataset": Task(
        "export datasets in formats that other code reads", (*_MODEL_GUIDED, "data", "export_dataset")
    ),
    "report": Task("make the paper's tables and figures from finished runs", ("report",)),
}
"""The tasks by name; each is the module of that name in `deux.tasks`."""

PLUGIN_SECTIONS = {
    "model": "depth_models",
    "explore": "explorers",
    "simulator": "simulators",
    "scenes": "scenes",
    "data": "readers",
}
"""The sections that choose a plugin, with its kind."""

_NAMING_OPTIONS = (
    ("seed_model", "name", "depth_models"),
    ("compare", "baseline", "explorers"),
    ("collect", "uncertainty", "uncertainties"),
    ("predict", "uncertainty", "uncertainties"),
    ("foundation", "source", "scenes"),
    ("explorer_training", "source", "scenes"),
)
"""Options of other sections that choose a plugin: section, option and kind."""

SINGLE_VALUES = ("pose", "seed", "training_data")
"""The sections that are a single value; all others are options by name."""

ALWAYS_READ = ("paths", "data")
"""Sections that any task may read: for the output folder, and for caching of frames."""

MEANS = {
    "collect": ("processes", "executor", "executor_options", "viewer"),
    "data": ("cache",),
    "training": ("num_workers", "checkpoint_minutes", "cuda_graphs"),
    "predict": ("batch_size", "video", "export", "voxel", "keep", "least_confidence", "agreement", "viewer"),
}
"""Options, by section, that do not affect results beyond the last bits of predictions: a run may be resumed with other
values."""

MEANS_NAMES = frozenset(f"{name}.{option}" for name, means in MEANS.items() for option in means)
"""The options of `MEANS` by their names on the command line."""


def without_means(name: str, section: Any) -> Any:
    """The plain content of a section without the options of `MEANS`."""
    means = MEANS.get(name)
    return {key: value for key, value in section.items() if key not in means} if means else section


class Sections:
    """The sections of a composed configuration that its task declares.

    Args:
        cfg: the composed configuration.
        outputs: the folder of runs, datasets and shared models.
    """

    def __init__(self, cfg: DictConfig, outputs: Path) -> None:
        self._cfg = cfg
        self.task = task_name(cfg)
        self.outputs = outputs
        self.names = TASKS[self.task].sections

    def read(self, name: str, target: type[T]) -> T:
        """A section as an object of a class, whose constructor defines its options.

        Raises:
            DeuxError: an option is unknown, of the wrong type or out of its range.
        """
        return construct(target, self._node(name), name)

    def plugin(self, name: str) -> PluginChoice:
        """The plugin that a section chooses, with all its options.

        Raises:
            DeuxError: the plugin or one of its options is unknown.
        """
        return registry().choose(PLUGIN_SECTIONS[name], self._node(name), name)

    def plain(self, name: str) -> Any:
        """A section as plain dictionaries, lists and values."""
        return self._node(name)

    @property
    def data_cache(self) -> Any:
        """`data.cache`, where frames are cached during training.

        It does not affect results, so tasks read it without declaring `data`, and it is not part of a run's identity.
        """
        return section(self._cfg, "data").get("cache", "auto")

    @property
    def seed(self) -> int:
        """The random seed.

        Raises:
            DeuxError: it is not a whole number that torch and numpy accept.
        """
        return check_seed(self._node("seed"))

    @property
    def identity(self) -> dict[str, Any]:
        """The run's identity: all options that its results depend on, including plugins' defaults, as JSON values."""
        content = {name: without_means(name, self.plain(name)) for name in self.names}
        content |= {name: self.plugin(name).description for name in self.names if name in PLUGIN_SECTIONS}
        return {"task": self.task, **content}

    def _node(self, name: str) -> Any:
        assert name in self.names, f"task={self.task} does not name the section {name!r}"
        return section(self._cfg, name)


def task_name(cfg: DictConfig) -> str:
    """The name of a configuration's task.

    Raises:
        DeuxError: it is missing or unknown.
    """
    with references_resolved("task"):
        name = cfg.get("task")
    if not (isinstance(name, str) and name in TASKS):
        raise DeuxError(f"there is no task called {shown(name)}: {near_matches(str(name), TASKS)}")
    return name


def section(cfg: DictConfig, name: str) -> Any:
    """A section's plain content: a dictionary of options, or a single value for `SINGLE_VALUES`.

    Raises:
        DeuxError: the section is missing, it is a single value instead of options or vice versa, or an interpolation
            cannot be resolved.
    """
    if name not in cfg:
        raise DeuxError(f"the section {name} was removed from the configuration, but the task reads it: keep it.")
    with references_resolved(name):
        content = cfg[name]
    if name not in SINGLE_VALUES:
        return plain_options(content, name)
    if OmegaConf.is_config(content):
        raise DeuxError(f"{name} must be a single value, but is {shown(plain(content, name))}.")
    return content


def check_plugins(cfg: DictConfig) -> None:
    """Raise DeuxError if a section of the task chooses a plugin that is not installed, or whose name is not unique.

    Nothing is imported, so that a run with a misspelt loss term ends at once. The explorer of a seed model with a
    checkpoint is not used, so its name need not be unique.
    """
    names = TASKS[task_name(cfg)].sections
    content = {name: section(cfg, name) for name in (*names, *ALWAYS_READ)}
    for kind, name in _named_plugins({name: content[name] for name in names}):
        registry().find(kind, name)
    seed_model = content.get("seed_model", {})
    if seed_model.get("explore") is not None and seed_model.get("checkpoint") is not None:
        registry().check_name("explorers", str(seed_model["explore"]))


def check_seed(seed: Any) -> int:
    """Return a random seed; raise DeuxError if it is not a whole number that torch and numpy accept."""
    if type(seed) is not int or not 0 <= seed < 2**32:
        raise DeuxError(f"seed is {seed!r}: it must be a whole number from 0 to {2**32 - 1}.")
    return seed


def check_plugin_options(cfg: DictConfig) -> None:
    """Raise DeuxError if a section of the task has an option that its plugin does not have, or of the wrong type.

    Plugins whose options all have their defaults are not imported. Call `check_plugins` first.
    """
    names = TASKS[task_name(cfg)].sections
    if "scenes" in names:
        check_seed(section(cfg, "seed"))  # otherwise a wrong seed would be reported for an option of `scenes`
    for name, kind in PLUGIN_SECTIONS.items():
        if name in names and set(options := section(cfg, name)) - {"name", *KINDS[kind].reserved}:
            registry().choose(kind, options, name)


def _named_plugins(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The plugins that the task's sections choose, as pairs of kind and name.

    Args:
        content: plain sections by name; missing options are reported when a section is read.
    """
    plugins = [(kind, content[name].get("name")) for name, kind in PLUGIN_SECTIONS.items() if name in content]
    plugins += [(kind, content[name].get(option)) for name, option, kind in _NAMING_OPTIONS if name in content]
    if content.get("seed_model", {}).get("checkpoint") is None:
        plugins.append(("explorers", content.get("seed_model", {}).get("explore")))
    explorers = content.get("compare", {}).get("explorers")
    plugins += [("explorers", name) for name in (explorers if isinstance(explorers, list) else [])]
    plugins += [("losses", term) for term in content.get("objective", {})]
    return [(kind, str(name)) for kind, name in plugins if name is not None]
