"""Composes the configuration from `conf/`, the YAML of other packages, and an entry for each plugin.

Plugins need no YAML: `model=<name>` selects `{name: <name>}`, and further options are added as `model.<option>=value`,
which `deux.options.construct` checks against the constructor.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import logging
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import hydra
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from hydra.plugins.search_path_plugin import SearchPathPlugin
from hydra.types import RunMode
from hydra.utils import to_absolute_path
from omegaconf import DictConfig, OmegaConf

from deux.callbacks import ACTIVE_COLLECTION, callback_names
from deux.command_record import record_folder
from deux.composition_errors import check_names, composition_error, raised_in_composition
from deux.errors import DeuxError, printable, shown
from deux.registry import registry
from deux.task_sections import (
    MEANS_NAMES,
    PLUGIN_SECTIONS,
    TASKS,
    Sections,
    check_plugins,
    section,
    task_name,
    without_means,
)

CONFIG_NAME = "config"

CALLBACK_GROUP = "callbacks"
"""The config group of callbacks, of which any number can be chosen, each with its own options."""

GIVEN_MODEL_TASKS = ("evaluate", "predict", "export", "report")
"""Tasks whose run folders are named after the task, since the configuration's model and explorer did not produce the
model or runs that they work on."""

OPEN_NODES = (
    "camera",
    "robot",
    "explore",
    "model",
    "simulator",
    "scenes",
    "data",
    "objective",
    "sampling",
    "verification",
    "training",
    "trainer",
    "callbacks",
    "collect.uncertainty_options",
    "collect.executor_options",
    "predict.uncertainty_options",
    "seed_model.options",
    "explorer_training",
    "report",
)
"""Nodes that are passed to constructors. Hydra accepts any key in them without "+"; `deux.options.construct` reports
misspelt ones, since it knows the constructor."""

_LONGEST_NAME = 60
"""Longest part of a plugin's name in the name of a run folder, in characters."""

_RECORDED = {
    "train": ("training_data",),
    "evaluate": ("evaluation.data",),
    "export_dataset": ("export_dataset.train", "export_dataset.validation", "export_dataset.test"),
}
"""Options that name folders of recorded frames, for tasks that generate frames in scenes if none is named."""

log = logging.getLogger(__name__)


def config_folder() -> Path:
    """The folder of the main configuration: the package `deux.conf`, or `conf/` beside the package `deux`.

    The latter serves `python -m deux` in a checkout while a wheel is installed: Python then imports `deux` from the
    checkout, which has no subpackage `deux.conf`.
    """
    try:
        package = importlib.import_module("deux.conf")
    except ModuleNotFoundError:
        return Path(__file__).resolve().parent.parent / "conf"
    return Path(package.__path__[0]).resolve()


def config_folders() -> list[Path]:
    """The configuration folders: deux's own, then those of other packages."""
    return [config_folder(), *package_folders().values()]


def package_folders() -> dict[str, Path]:
    """The configuration folders of other packages (entry-point group `deux.conf`), by package name.

    A folder that cannot be found is skipped with a warning, so that a broken package does not stop the command.
    """
    folders = {}
    for entry in registry().entry_points("deux.conf"):
        package = entry.dist.name if entry.dist else entry.name
        try:
            folders[package] = Path(str(resources.files(entry.value)))
        except Exception as error:  # this imports the third-party package, which may raise anything
            log.warning("the configuration of %s is left out, %s cannot be imported: %s", package, entry.value, error)
    return folders


class PrintableFormatter(logging.Formatter):
    """Formats warnings for the console (`conf/hydra/default.yaml`), with terminal control characters escaped."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record, with unprintable characters of each line escaped."""
        return "\n".join(printable(line) for line in super().format(record).split("\n"))


class PackageSearchPath(SearchPathPlugin):
    """Lets Hydra find the YAML of packages that declare the entry-point group `deux.conf`, after our own."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append the folders."""
        for package, folder in package_folders().items():
            search_path.append(provider=package, path=f"file://{folder}")


class ForgetJobs(Callback):
    """Frees the configuration of each job that has ended; used by conf/hydra/default.yaml.

    Hydra's launchers keep each job's result, with its two configurations, until the sweep ends: a quarter of a MiB per
    job. Sweepers only need a result's overrides and return value.
    """

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        """Drop both configurations."""
        job_return.cfg = job_return.hydra_cfg = None


def register_configuration() -> None:
    """Register the plugins with Hydra. Call it before composing; repeated calls have no effect."""
    Plugins.instance().register(PackageSearchPath)
    store = ConfigStore.instance()
    open_nodes = OmegaConf.create()
    for name in OPEN_NODES:
        OmegaConf.update(open_nodes, name, {}, force_add=True)
        OmegaConf.set_struct(OmegaConf.select(open_nodes, name), False)
    store.store(name="open_nodes", node=open_nodes, provider="deux")
    folders = config_folders()
    for group, kind in PLUGIN_SECTIONS.items():
        # Plugins with YAML get no node: Hydra would merge the node into the YAML, and warn.
        described = group_files(group, folders)
        for name in registry().names(kind):
            if name not in described:
                store.store(group=group, name=name, node={"name": name}, provider="deux")
    for name in callback_names():
        if name != ACTIVE_COLLECTION:  # it has YAML
            package = f"{CALLBACK_GROUP}.{name}"
            store.store(group=CALLBACK_GROUP, name=name, node={}, package=package, provider="deux")


def group_files(group: str, folders: Iterable[Path]) -> set[str]:
    """The names of a config group's YAML files in the given configuration folders."""
    return {path.stem for folder in folders for path in (folder / group).glob("*.yaml")}


def compose(overrides: Sequence[str] = ()) -> DictConfig:
    """Compose the configuration that the command line would use for these overrides; works within a running command.

    Raises:
        DeuxError: an override refers to nothing, or a plugin is not installed.

    Example:
        >>> cfg = compose(["model=voiced", "camera.width=256"])
        >>> cfg.model.name, cfg.camera.width
        ('voiced', 256)
    """
    register_configuration()
    check_names(overrides)
    command = GlobalHydra.instance().hydra  # Hydra has one state for the whole process
    GlobalHydra.instance().clear()
    try:
        with hydra.initialize_config_dir(str(config_folder()), job_name="deux", version_base="1.3"):
            cfg = hydra.compose(CONFIG_NAME, list(overrides))
    except Exception as error:
        if not raised_in_composition(error):
            raise
        raise composition_error(error) from error
    finally:
        GlobalHydra.instance().hydra = command
    check_plugins(cfg)
    return cfg


def check_unused(cfg: DictConfig, overrides: Iterable[str]) -> None:
    """Raise DeuxError if an override has no effect although the user probably relies on it.

    Checked are: epochs of a training that is limited by steps; recorded frames for a task that takes none; and a reader
    of recorded frames without their folder, where the task would spend minutes on generated scenes instead.

    Args:
        cfg: the composed configuration.
        overrides: the overrides of the command line.
    """
    task, steps = task_name(cfg), OmegaConf.select(cfg, "training.steps")
    for override in overrides:
        name, _, value = override.lstrip("+").partition("=")
        if name in ("training_data", "data") and value not in ("null", "deux") and name not in TASKS[task].sections:
            able = " or ".join(f"task={other}" for other, one in TASKS.items() if name in one.sections)
            raise DeuxError(f"{override} has no effect with task={task}, which takes no recorded frames: {able} does.")
        if name == "data" and value != "deux" and not _names_recorded_frames(cfg, task):
            named = " or ".join(f"{option}=" for option in _RECORDED[task])
            raise DeuxError(
                f"{override} says how recorded frames are read and nothing names their folder: {named} does; without "
                f"{override} task={task} works in scenes."
            )
        if name == "training.epochs" and steps is not None:
            raise DeuxError(
                f"training.epochs={value} has no effect while training.steps is {steps}: set training.steps=null too."
            )


def _names_recorded_frames(cfg: DictConfig, task: str) -> bool:
    """Whether the configuration names a folder of recorded frames; also true for tasks that check this themselves."""
    return task not in _RECORDED or any(OmegaConf.select(cfg, option) for option in _RECORDED[task])


def in_sweep() -> bool:
    """Whether this job belongs to a sweep (`-m`); such jobs show no progress bar."""
    return HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN


def run_folder() -> Path:
    """The absolute path of the current run's folder; only within a Hydra job."""
    return Path(HydraConfig.get().runtime.output_dir)


def job_overrides() -> list[str]:
    """The current run's overrides as they were written; in a sweep, with the job's own values."""
    return list(HydraConfig.get().overrides.task)


def user_path(path: str | Path) -> Path:
    """Resolve a path that the user gave, relative to the folder in which the command was started; ~ is expanded.

    Raises:
        DeuxError: it is not a valid path.
    """
    if "\0" in str(path):
        raise DeuxError(f"{shown(str(path))} is no path: it holds a zero byte.")
    try:
        return Path(to_absolute_path(str(Path(path).expanduser())))
    except RuntimeError as error:
        raise DeuxError(f"{path} is no path: {error}") from error


def run_id(cfg: DictConfig) -> str:
    """The name of a configuration's run folder: "<model>-<explore>-<hash>", for some tasks with the task's name.

    The hash covers all options that affect the results, so that the same command finds its folder again and resumes.
    """
    task = task_name(cfg)
    outputs_folder(cfg)  # checks it: by default, it contains the run folder
    content = {name: section(cfg, name) for name in TASKS[task].sections}
    hashed = {name: without_means(name, found) for name, found in content.items()}
    return f"{_run_name(task, content)}-{_hash({'task': task, **hashed})}"


def outputs_folder(cfg: DictConfig) -> Path:
    """The folder of runs, datasets and shared models.

    Raises:
        DeuxError: `paths.outputs` is not a path.
    """
    outputs = section(cfg, "paths").get("outputs")
    if not (isinstance(outputs, str) and outputs.strip()):
        raise DeuxError(f"paths.outputs must be the path of a folder, but is {shown(outputs)}.")
    return user_path(outputs)


def sections_of(cfg: DictConfig) -> Sections:
    """The sections of the configuration that its task reads."""
    return Sections(cfg, outputs_folder(cfg))


def _run_name(task: str, content: Mapping[str, Any]) -> str:
    if task in (*GIVEN_MODEL_TASKS, "compare_explorers"):
        return task
    names = (str(content.get(name, {}).get("name")) for name in ("model", "explore"))
    # Made safe for a folder's name; that a plugin does not exist is reported later.
    model, explorer = (re.sub(r"[^\w-]", "_", name)[:_LONGEST_NAME] for name in names)
    if task == "train_explorer":
        return f"{task}-{explorer}"
    return f"{task}-{model}-{explorer}" if task == "study_uncertainty" else f"{model}-{explorer}"


def _hash(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _sweep_id() -> str:
    overrides = (argument for argument in sys.argv[1:] if "=" in argument)
    # The launcher, options that do not affect results and the place of the outputs do not make it another sweep.
    return _hash(
        sorted(
            override
            for override in overrides
            if override.lstrip("+~").partition("=")[0] not in MEANS_NAMES
            and not re.match(r"[+~]*(paths\.|hydra[./](?!sweeper\.params\.))", override)
        )
    )


def _run_id(_root_: DictConfig) -> str:
    return run_id(_root_)


def _names(kind: str) -> str:
    return ", ".join(registry().names(kind))


def _task_list() -> str:
    return "\n".join(f"  {name:<17} {purpose}" for name, (purpose, _) in TASKS.items())


# Registered at import: launchers import this module in their processes, but do not call register_configuration there.
OmegaConf.register_new_resolver("deux.run_id", _run_id, replace=True)
OmegaConf.register_new_resolver("deux.record_folder", record_folder, replace=True)
# Cached: Hydra passes the cache on to the sweep's jobs, so that jobs in other processes use the same folder.
OmegaConf.register_new_resolver("deux.sweep_id", _sweep_id, use_cache=True, replace=True)
OmegaConf.register_new_resolver("deux.plugins", _names, replace=True)
OmegaConf.register_new_resolver("deux.tasks", _task_list, replace=True)
