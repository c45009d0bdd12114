"""The tasks, the sections of the configuration that each of them names, and how a task reads them.

A section is a node at the top of the configuration. It belongs to the package that uses it, whose dataclass or plugin
says which options it has; a task reads and checks the sections that it names and no others.
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
    """What `task=` can be.

    Args:
        purpose: what it does, for the help page.
        sections: the sections that it reads; they also decide which run folder the command has.
    """

    purpose: str
    sections: tuple[str, ...]


_SCENES = ("simulator", "camera", "robot", "scenes")
_COLLECTION = (*_SCENES, "explore", "collect", "sampling", "verification")
_TRAINING = ("model", "objective", "pose", "training", "trainer", "foundation")
_MODEL_GUIDED = (*_COLLECTION, *_TRAINING, "seed_model", "evaluation", "seed")
"""Validation frames, of which `evaluation` says how many, are part of every training."""

TASKS = {
    "experiment": Task(
        "collect, train the seed model, explore with it, train the final model, evaluate",
        (*_MODEL_GUIDED, "callbacks"),
    ),
    "collect": Task("explore the training scenes and write the dataset", _MODEL_GUIDED),
    "train": Task(
        "train the depth model on the dataset, which is collected first if it is not there",
        (*_MODEL_GUIDED, "callbacks", "data", "training_data"),
    ),
    "evaluate": Task("evaluate a trained model on the held-out scenes", (*_MODEL_GUIDED, "callbacks", "data")),
    "predict": Task(
        "complete the depth of one frame or of many, from files and to files", ("predict", "model", "camera", "data")
    ),
    "train_explorer": Task(
        "train the policy of a learned explorer with PPO", (*_SCENES, "explore", "explorer_training", "seed")
    ),
    "compare_explorers": Task(
        "measure what the explorers see, in scenes that none of them knows",
        (*_SCENES, "explore", "collect", "sampling", "compare", "seed_model", "model", "trainer", "seed"),
    ),
    "study_uncertainty": Task(
        "measure which uncertainty points at the depth model's errors, in scenes that it never saw", _MODEL_GUIDED
    ),
    "export": Task(
        "write a trained model as an ONNX file, or for the code that its authors published",
        ("export", "model", "camera"),
    ),
    "export_dataset": Task(
        "write datasets in the layouts that foreign code reads", (*_MODEL_GUIDED, "data", "export_dataset")
    ),
    "report": Task("turn finished runs into the paper's tables and figures", ("report",)),
}
"""The tasks by name; each is the module of that name in `deux.tasks`."""

PLUGIN_SECTIONS = {
    "model": "depth_models",
    "explore": "explorers",
    "simulator": "simulators",
    "scenes": "scenes",
    "data": "readers",
}
"""The sections that choose a plugin, and of which kind."""

_NAMING_OPTIONS = (
    ("seed_model", "name", "depth_models"),
    ("compare", "baseline", "explorers"),
    ("collect", "uncertainty", "uncertainties"),
    ("predict", "uncertainty", "uncertainties"),
    ("foundation", "source", "scenes"),
    ("explorer_training", "source", "scenes"),
)
"""Options of other sections that name a plugin: section, option and kind."""

SINGLE_VALUES = ("pose", "seed", "training_data")
"""The sections that hold one value; all others hold options by name."""

ALWAYS_READ = ("paths", "data")
"""Sections that a task may read without naming them: where its outputs are kept, and where frames are cached."""

MEANS = {
    "collect": ("processes", "executor", "executor_options", "viewer"),
    "data": ("cache",),
    "training": ("num_workers", "checkpoint_minutes", "cuda_graphs"),
    "predict": ("batch_size", "video", "export", "voxel", "keep", "least_confidence", "agreement", "viewer"),
}
"""Options of sections by which nothing that a task makes changes beyond the last bits of predictions: a command with
others goes on where one was."""

MEANS_NAMES = frozenset(f"{name}.{option}" for name, found in MEANS.items() for option in found)
"""The same options by their names on the command line."""


def without_means(name: str, section: Any) -> Any:
    """A section's plain content without the options of `MEANS`."""
    means = MEANS.get(name)
    return {key: value for key, value in section.items() if key not in means} if means else section


class Sections:
    """The sections of a composed configuration that its task names.

    Args:
        cfg: what Hydra composed.
        outputs: the folder of runs, datasets and shared models.
    """

    def __init__(self, cfg: DictConfig, outputs: Path) -> None:
        self._cfg = cfg
        self.task = task_name(cfg)
        self.outputs = outputs
        self.names = TASKS[self.task].sections

    def read(self, name: str, target: type[T]) -> T:
        """A section as an object of the class whose constructor says which options it has.

        Raises:
            DeuxError: an option is unknown, of another type or out of its range.
        """
        return construct(target, self._node(name), name)

    def plugin(self, name: str) -> PluginChoice:
        """The plugin that a section chooses, with all its options.

        Raises:
            DeuxError: there is no such plugin, or an option that it does not have.
        """
        return registry().choose(PLUGIN_SECTIONS[name], self._node(name), name)

    def plain(self, name: str) -> Any:
        """A section as plain dictionaries, lists and values."""
        return self._node(name)

    @property
    def data_cache(self) -> Any:
        """`data.cache`, which says where frames are kept while a model trains.

        No result depends on it: it belongs to no run's identity, and tasks that train read it without naming `data`.
        """
        return section(self._cfg, "data").get("cache", "auto")

    @property
    def seed(self) -> int:
        """The random seed.

        Raises:
            DeuxError: it is no whole number that torch and numpy take.
        """
        return check_seed(self._node("seed"))

    @property
    def identity(self) -> dict[str, Any]:
        """What the task's work depends on, plugins' defaults included, as JSON values: what a run folder belongs to."""
        content = {name: without_means(name, self.plain(name)) for name in self.names}
        content |= {name: self.plugin(name).description for name in self.names if name in PLUGIN_SECTIONS}
        return {"task": self.task, **content}

    def _node(self, name: str) -> Any:
        assert name in self.names, f"task={self.task} does not name the section {name!r}"
        return section(self._cfg, name)


def task_name(cfg: DictConfig) -> str:
    """The task that a configuration names.

    Raises:
        DeuxError: it names none, or none that there is.
    """
    with references_resolved("task"):
        name = cfg.get("task")
    if not (isinstance(name, str) and name in TASKS):
        raise DeuxError(f"there is no task called {shown(name)}: {near_matches(str(name), TASKS)}")
    return name


def section(cfg: DictConfig, name: str) -> Any:
    """A section's plain content: a dictionary of options, or of `SINGLE_VALUES` the value; references are resolved.

    Raises:
        DeuxError: it is not there, it is one value where it has options or the other way round, or a reference in it
            leads nowhere.
    """
    if name not in cfg:
        raise DeuxError(f"the section {name} was taken out of the configuration, but the task reads it.")
    with references_resolved(name):
        found = cfg[name]
    if name not in SINGLE_VALUES:
        return plain_options(found, name)
    if OmegaConf.is_config(found):
        raise DeuxError(f"{name} is a single value, but holds {shown(plain(found, name))}.")
    return found


def check_plugins(cfg: DictConfig) -> None:
    """Raise DeuxError if a section of the task names a plugin that is not installed, or is installed twice.

    Nothing is imported, so a run with a misspelt loss term ends before any work is done. The explorer of a seed model
    that is there already is not asked for: of two that have its name, it may be either.
    """
    names = TASKS[task_name(cfg)].sections
    content = {name: section(cfg, name) for name in (*names, *ALWAYS_READ)}
    for kind, name in _named_plugins({name: content[name] for name in names}):
        registry().find(kind, name)
    seed_model = content.get("seed_model", {})
    if seed_model.get("explore") is not None and seed_model.get("checkpoint") is not None:
        registry().check_name("explorers", str(seed_model["explore"]))


def check_seed(seed: Any) -> int:
    """The random seed; DeuxError if it is no whole number that torch and numpy take."""
    if type(seed) is not int or not 0 <= seed < 2**32:
        raise DeuxError(f"seed is {seed!r}: the random seed is a whole number from 0 to {2**32 - 1}.")
    return seed


def check_plugin_options(cfg: DictConfig) -> None:
    """Raise DeuxError if a section of the task has an option that its plugin does not have, or of another type.

    Plugins with all options at their defaults are not imported. Call `check_plugins` first.
    """
    names = TASKS[task_name(cfg)].sections
    if "scenes" in names:
        check_seed(section(cfg, "seed"))  # it draws scenes, and its own name is the one to tell
    for name, kind in PLUGIN_SECTIONS.items():
        if name in names and set(chosen := section(cfg, name)) - {"name", *KINDS[kind].reserved}:
            registry().choose(kind, chosen, name)


def _named_plugins(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The plugins that the task's sections name: kind and name.

    Args:
        content: plain sections by name; an option that they lack is told by whoever reads the section.
    """
    found = [(kind, content[name].get("name")) for name, kind in PLUGIN_SECTIONS.items() if name in content]
    found += [(kind, content[name].get(option)) for name, option, kind in _NAMING_OPTIONS if name in content]
    if content.get("seed_model", {}).get("checkpoint") is None:
        found.append(("explorers", content.get("seed_model", {}).get("explore")))
    explorers = content.get("compare", {}).get("explorers")
    found += [("explorers", name) for name in (explorers if isinstance(explorers, list) else [])]
    found += [("losses", term) for term in content.get("objective", {})]
    return [(kind, str(name)) for kind, name in found if name is not None]
