"""Every option of the configuration with every kind of wrong value: one sentence, or a run that begins.

A case is composed as the command line does it, its sections are read by a task that names them, and it ends where the
task would open its run folder. A full pass is `-m slow`; the suite takes a sample of it.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

import hydra
import pytest
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf, open_dict

from deux.__main__ import run_task, sentence_of
from deux.composition_errors import check_names
from deux.errors import printable
from deux.configuration import CONFIG_NAME, config_folder, register_configuration, sections_of
from deux.options import options
from deux.registry import KINDS, registry
from deux.task_sections import PLUGIN_SECTIONS, TASKS

VALUES = {
    "null": "null",
    "true": "true",
    "zero": "0",
    "negative": "-1",
    "fraction": "0.3",
    "large": "10000000",
    "10^20": "1" + 20 * "0",
    "10^400": "1" + 400 * "0",
    "10^5000": "1" + 5000 * "0",
    "1e400": "1e400",
    "-inf": "-inf",
    "nan": "nan",
    "empty": "''",
    "blank": "' '",
    "text": "abc",
    "digits": "'12'",
    "unicode": "'d\u00e9j\u00e0 \u65e5\u672c \u202e\U0001f600'",
    "bytes": "'a\udcff'",
    "long": 5000 * "x",
    "escape": "'\x1b[31m\x07'",
    "list": "[1,2]",
    "empty list": "[]",
    "nested": "[[1],[[abc]]]",
    "nulls": "[null,null]",
    "node": "{a: 1}",
    "empty node": "{}",
    "deep": 60 * "{a: " + "1" + 60 * "}",
    "missing": "???",
    "unknown": "${nothing}",
    "of the environment": "${oc.env:HOME}",
    "of no environment": "${oc.env:DEUX_NOTHING}",
    "cyclic": "${KEY}",
    "root": "${task}",
    "all": "${.}",
    "no resolver": "${nothing:1}",
    "list in quotes": "'[1]'",
    "path": "/dev/null/x",
}
"""Values by what they are called; KEY is the option's own name."""

DELETED = "deleted"
"""The case in which the option is taken out of the configuration."""

GROUPS = ("explore", "model", "simulator", "data", "scenes", "scale", "report", "callbacks", "experiment", "hydra")
"""The options that choose files, which Hydra composes in another way."""

BASE = ("scale=debug", "trainer.accelerator=cpu", "training.sources=recent")


class Begun(BaseException):
    """A task has read its sections and asks for its run folder."""


@pytest.fixture(scope="module")
def loaded() -> Iterator[tuple[object, DictConfig]]:
    """Hydra's loader, and the configuration that the cases change."""
    register_configuration()
    with initialized() as loader:
        yield loader, composed(loader, BASE)


@contextmanager
def initialized() -> Iterator[ConfigLoaderImpl]:
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(config_folder()), job_name="deux", version_base="1.3"):
        yield GlobalHydra.instance().config_loader()


def composed(loader: ConfigLoaderImpl, overrides: tuple[str, ...]) -> DictConfig:
    return loader.load_configuration(CONFIG_NAME, list(overrides), hydra.types.RunMode.RUN)


def changed(loader: ConfigLoaderImpl, base: DictConfig, override: str, task: str) -> DictConfig:
    """The base with one more override; as Hydra does it, without composing all files again."""
    (parsed,) = OverridesParser.create(config_loader=loader).parse_overrides([override])
    if parsed.key_or_group in GROUPS:
        return composed(loader, (*BASE, f"task={task}", override))
    cfg = base.copy()
    ConfigLoaderImpl._apply_overrides_to_config([parsed], cfg)
    return cfg


def begin(cfg: DictConfig) -> None:
    """What happens between composition and the run folder."""
    str(cfg.hydra.run.dir)
    with open_dict(cfg):
        hydra_node = cfg.pop("hydra")
    HydraConfig.instance().set_config(OmegaConf.create({"hydra": hydra_node}))
    run_task(cfg)


def outcome(loader: ConfigLoaderImpl, base: DictConfig, override: str, task: str) -> str:
    """"begun" or "told"; otherwise what is wrong with how the case ends."""
    signal.alarm(30)
    try:
        check_names([override])
        begin(changed(loader, base, override, task))
    except Begun:
        return "begun"
    except TimeoutError:
        return "hangs"
    except Exception as error:
        signal.alarm(0)
        sentence = sentence_of(error)
        sentence = sentence and printable(sentence)
        if sentence is None:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            return f"{type(error).__name__}: {str(error)[:150]} at {frame.filename}:{frame.lineno}"
        if "Traceback" in sentence or len(sentence) > 2000:
            return f"no sentence: {sentence[:150]!r}"
        return "told"
    finally:
        signal.alarm(0)
    return "begun"


def keys(cfg: DictConfig) -> list[str]:
    """Every node and leaf, and the options of the chosen plugins, by dotted name."""
    found: list[str] = []

    def visit(node: DictConfig, where: str) -> None:
        for key in node:
            name = f"{where}{key}"
            found.append(name)
            child = node._get_node(key)
            if isinstance(child, DictConfig) and not child._is_none():
                visit(child, f"{name}.")

    without_hydra = cfg.copy()
    with open_dict(without_hydra):
        del without_hydra["hydra"]
    visit(without_hydra, "")
    for section, kind in PLUGIN_SECTIONS.items():
        cls = registry().get(kind, cfg[section].name)
        found += [f"{section}.{option}" for option in options(cls, KINDS[kind].given)]
    from deux.contracts import Robot
    from deux.training.training_settings import TrainingSettings

    found += [f"robot.{option}" for option in options(Robot)]
    found += [f"training.{option}" for option in options(TrainingSettings)]
    found += [f"trainer.{option}" for option in ("precision", "max_time", "logger", "callbacks", "strategy", "plugins")]
    found += ["callbacks.early_stopping", "objective.sparse_depth", "hydra.run.dir", "hydra.job.name"]
    return sorted(set(found))


def cases(cfg: DictConfig) -> list[tuple[str, str]]:
    """Kind and override of every case; the task is chosen among those that name the section."""
    found = []
    for key in keys(cfg):
        found += [(kind, f"{key}={value.replace('KEY', key)}") for kind, value in VALUES.items()]
        found.append((DELETED, f"~{key}"))
    return found


def tasks_of(override: str) -> list[str]:
    section = override.lstrip("~").partition("=")[0].partition(".")[0]
    return [name for name, task in TASKS.items() if section in task.sections] or ["experiment"]


@pytest.fixture
def stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no task go beyond its run folder, nor take more than 30 seconds."""

    def begun() -> None:
        raise Begun

    from deux.tasks.datasets import Datasets
    from deux.tasks.seed_model import SeedModel

    monkeypatch.setattr(Datasets, "_build", lambda *_, **__: begun())
    monkeypatch.setattr(SeedModel, "get", lambda *_: begun())
    for task in TASKS:
        module = __import__(f"deux.tasks.{task}", fromlist=["run"])
        if hasattr(module, "run_folder"):
            monkeypatch.setattr(module, "run_folder", begun)

    def late(*_: object) -> None:
        raise TimeoutError

    monkeypatch.setattr(signal, "alarm", signal.alarm)
    signal.signal(signal.SIGALRM, late)
