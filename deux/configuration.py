"""How a configuration is composed: the folder `conf/`, other packages' YAML, and one entry for each plugin.

A plugin needs no YAML: `model=<name>` selects `{name: <name>}`, and its further options are added as
`model.<option>=value`, which `deux.options.construct` checks against the constructor.
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
"""The config group of which any number of options may be chosen; each comes with its own options."""

GIVEN_MODEL_TASKS = ("evaluate", "predict", "export", "report")
"""The tasks whose run folders are named by the task: neither the model nor the explorer of the configuration made what
they work on."""

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
"""The nodes that become constructor arguments. Hydra takes any key there without a "+"; misspelt ones are caught by
`deux.options.construct`, which knows the constructor."""

_LONGEST_NAME = 60
"""Characters of a plugin's name in the name of a run folder."""

_RECORDED = {
    "train": ("training_data",),
    "evaluate": ("evaluation.data",),
    "export_dataset": ("export_dataset.train", "export_dataset.validation", "export_dataset.test"),
}
"""The options that name folders of recorded frames, of tasks that work in scenes where none is named."""

log = logging.getLogger(__name__)


def config_folder() -> Path:
    """The folder of the main configuration: the package `deux.conf`, or `conf/` beside the package `deux`.

    The second is for `python -m deux` in a checkout while a wheel of deux is installed: Python then imports `deux`
    from the checkout, where `deux.conf` is not one of its subfolders.
    """
    try:
        package = importlib.import_module("deux.conf")
    except ModuleNotFoundError:
        return Path(__file__).resolve().parent.parent / "conf"
    return Path(package.__path__[0]).resolve()


def config_folders() -> list[Path]:
    """The folders of configuration: deux's own, then those of other packages."""
    return [config_folder(), *package_folders().values()]


def package_folders() -> dict[str, Path]:
    """The YAML folders of other packages (entry-point group `deux.conf`), by the name of their package.

    A folder that cannot be found is left out with a warning, so that a broken package does not stop the command.
    """
    folders = {}
    for entry in registry().entry_points("deux.conf"):
        package = entry.dist.name if entry.dist else entry.name
        try:
            folders[package] = Path(str(resources.files(entry.value)))
        except Exception as error:  # the foreign package is imported here, which may raise anything
            log.warning("the configuration of %s is left out, %s cannot be imported: %s", package, entry.value, error)
    return folders


class PrintableFormatter(logging.Formatter):
    """Warnings on the console (`conf/hydra/default.yaml`), without characters that a terminal would obey."""

    def format(self, record: logging.LogRecord) -> str:
        """The record's lines."""
        return "\n".join(printable(line) for line in super().format(record).split("\n"))


class PackageSearchPath(SearchPathPlugin):
    """Lets Hydra find the YAML of packages that declare the entry-point group `deux.conf`, after our own."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append the folders."""
        for package, folder in package_folders().items():
            search_path.append(provider=package, path=f"file://{folder}")


class ForgetJobs(Callback):
    """Lets go of the configuration of each job that has ended; part of conf/hydra/default.yaml.

    Hydra's launchers keep what a job returned until the whole sweep is done, its two configurations included: a quarter
    of a MiB for each job. Sweepers that look at a job's result need its overrides and its return value only.
    """

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        """Called by Hydra when a job has ended."""
        job_return.cfg = job_return.hydra_cfg = None


def register_configuration() -> None:
    """Make the plugins known to Hydra. Call it before anything is composed; calling it again does no harm."""
    Plugins.instance().register(PackageSearchPath)
    store = ConfigStore.instance()
    open_nodes = OmegaConf.create()
    for name in OPEN_NODES:
        OmegaConf.update(open_nodes, name, {}, force_add=True)
        OmegaConf.set_struct(OmegaConf.select(open_nodes, name), False)
    store.store(name="open_nodes", node=open_nodes, provider="deux")
    folders = config_folders()
    for group, kind in PLUGIN_SECTIONS.items():
        # Hydra merges a stored node into YAML of the same name and warns, so a plugin that has YAML gets no node.
        described = group_files(group, folders)
        for name in registry().names(kind):
            if name not in described:
                store.store(group=group, name=name, node={"name": name}, provider="deux")
    for name in callback_names():
        if name != ACTIVE_COLLECTION:  # which has YAML
            package = f"{CALLBACK_GROUP}.{name}"
            store.store(group=CALLBACK_GROUP, name=name, node={}, package=package, provider="deux")


def group_files(group: str, folders: Iterable[Path]) -> set[str]:
    """The names of a config group's YAML files in the given folders of configuration."""
    return {path.stem for folder in folders for path in (folder / group).glob("*.yaml")}


def compose(overrides: Sequence[str] = ()) -> DictConfig:
    """The configuration that the command line would get from these overrides; also within a running command.

    Raises:
        DeuxError: an override that names nothing, or a plugin that is not installed.

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
    """Raise DeuxError if an override would be without effect where one expects the most of it.

    These are epochs, where the training has a number of steps, recorded frames, where the task takes none, and a reader
    of recorded frames, where none are named: a forgotten folder would be minutes of work on generated scenes.

    Args:
        cfg: what the overrides were composed to.
        overrides: of the command line.
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
    """Whether a folder of recorded frames is named, or the task has its own word on that."""
    return task not in _RECORDED or any(OmegaConf.select(cfg, option) for option in _RECORDED[task])


def in_sweep() -> bool:
    """Whether this job is one of a sweep (`-m`): it then shows no progress bar."""
    return HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN


def run_folder() -> Path:
    """The folder of the run that is under way, absolute. There is one only inside a Hydra job."""
    return Path(HydraConfig.get().runtime.output_dir)


def job_overrides() -> list[str]:
    """The overrides of the run that is under way, as they were written; of a sweep's job, its own values."""
    return list(HydraConfig.get().overrides.task)


def user_path(path: str | Path) -> Path:
    """A path as the user meant it: relative to the folder in which the command was started, ~ being the home folder.

    Raises:
        DeuxError: no path can be called so.
    """
    if "\0" in str(path):
        raise DeuxError(f"{shown(str(path))} is no path: it holds a zero byte.")
    try:
        return Path(to_absolute_path(str(Path(path).expanduser())))
    except RuntimeError as error:
        raise DeuxError(f"{path} is no path: {error}") from error


def run_id(cfg: DictConfig) -> str:
    """The name of a configuration's run folder: "<model>-<explore>-<hash>", or with the task where that says more.

    The hash is of everything that makes the run what it is: the same command finds its folder again and goes on where
    it was.
    """
    task = task_name(cfg)
    outputs_folder(cfg)  # which the run folder lies in by default
    content = {name: section(cfg, name) for name in TASKS[task].sections}
    hashed = {name: without_means(name, found) for name, found in content.items()}
    return f"{_run_name(task, content)}-{_hash({'task': task, **hashed})}"


def outputs_folder(cfg: DictConfig) -> Path:
    """The folder of runs, datasets and shared models.

    Raises:
        DeuxError: `paths.outputs` is no path.
    """
    outputs = section(cfg, "paths").get("outputs")
    if not (isinstance(outputs, str) and outputs.strip()):
        raise DeuxError(f"paths.outputs must be the path of a folder, but is {shown(outputs)}.")
    return user_path(outputs)


def sections_of(cfg: DictConfig) -> Sections:
    """The sections that the configuration's task names."""
    return Sections(cfg, outputs_folder(cfg))


def _run_name(task: str, content: Mapping[str, Any]) -> str:
    if task in (*GIVEN_MODEL_TASKS, "compare_explorers"):
        return task
    names = (str(content.get(name, {}).get("name")) for name in ("model", "explore"))
    # A part of a folder's name, also where there is no plugin of that name, which is told later.
    model, explorer = (re.sub(r"[^\w-]", "_", name)[:_LONGEST_NAME] for name in names)
    if task == "train_explorer":
        return f"{task}-{explorer}"
    return f"{task}-{model}-{explorer}" if task == "study_uncertainty" else f"{model}-{explorer}"


def _hash(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _sweep_id() -> str:
    overrides = (argument for argument in sys.argv[1:] if "=" in argument)
    # Whatever launches its jobs, by whatever means they do their work and wherever their outputs are kept, it is the
    # same sweep.
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


# At import, not in register_configuration: launchers that start other processes import this module there and no more.
OmegaConf.register_new_resolver("deux.run_id", _run_id, replace=True)
OmegaConf.register_new_resolver("deux.record_folder", record_folder, replace=True)
# Cached: Hydra hands the cache on to the sweep's jobs, so those in other processes name the same folder.
OmegaConf.register_new_resolver("deux.sweep_id", _sweep_id, use_cache=True, replace=True)
OmegaConf.register_new_resolver("deux.plugins", _names, replace=True)
OmegaConf.register_new_resolver("deux.tasks", _task_list, replace=True)
