"""Every option of the configuration with every kind of wrong value: one sentence, or a run that begins.

A case is composed as the command line does it, a task that names the option's section reads its sections, and the case
ends where the task would open its run folder. The suite takes a sample; every option is `-m slow`.
"""

from __future__ import annotations

import random
import signal
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import hydra
import numpy as np
import pytest
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode
from omegaconf import DictConfig, open_dict
from PIL import Image

from deux.__main__ import run_task, sentence_of
from deux.collection.collect_settings import CollectSettings
from deux.composition_errors import check_names
from deux.configuration import CONFIG_NAME, config_folder, register_configuration
from deux.contracts import Robot
from deux.deployment.model_files import save_model
from deux.errors import printable
from deux.options import options
from deux.plugin_kinds import KINDS
from deux.registry import registry
from deux.task_sections import PLUGIN_SECTIONS, TASKS
from deux.tasks.datasets import Datasets
from deux.tasks.seed_model import SeedModel
from deux.training.fit import make_trainer
from deux.training.training_settings import TrainingSettings

RUN = RunMode.RUN

SMALL_MODELS = {
    "kbnet": {"image_filters": (4, 8, 8, 8, 8), "depth_filters": (4,) * 5, "decoder_filters": (8, 8, 8, 8, 4)}
}

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

FRAME = {"checkpoint": "model.safetensors", "image": "image.png", "sparse": "points.png", "intrinsics": "K.txt"}
"""The files of `task=predict`."""

SECONDS = 60
"""That a case may take, on a machine that is busy with other things."""

BASE = ("scale=debug", "trainer.accelerator=cpu", "training.sources=recent")


class Begun(BaseException):
    """A task has read its sections and asks for its run folder."""


class Bases(NamedTuple):
    """Hydra's loader; and by task the overrides that each case begins with, and what they compose."""

    loader: ConfigLoaderImpl
    overrides: dict[str, tuple[str, ...]]
    composed: dict[str, DictConfig]


def changed(bases: Bases, task: str, override: str) -> DictConfig:
    """A task's configuration with one more override, as Hydra makes it, which reads no file again but for a group."""
    (parsed,) = OverridesParser.create(config_loader=bases.loader).parse_overrides([override])
    if parsed.key_or_group in GROUPS:
        return bases.loader.load_configuration(CONFIG_NAME, [*bases.overrides[task], override], RUN)
    cfg = bases.composed[task].copy()
    ConfigLoaderImpl._apply_overrides_to_config([parsed], cfg)
    return cfg


def begin(cfg: DictConfig) -> None:
    """What the command line does between composition and the run folder, and the task until then."""
    str(cfg.hydra.run.dir)
    with open_dict(cfg):
        del cfg["hydra"]
    run_task(cfg)


def outcome(bases: Bases, task: str, override: str) -> str:
    """ "begun" or "told", or else what is wrong with how the case ends."""
    signal.alarm(SECONDS)
    try:
        check_names([override])
        begin(changed(bases, task, override))
    except Begun:
        return "begun"
    except TimeoutError:
        return f"takes more than {SECONDS} s"
    except Exception as error:
        return _judged(error)
    finally:
        signal.alarm(0)
    return "begun"


def _judged(error: Exception) -> str:
    sentence = sentence_of(error)
    if sentence is None:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:200]} in {place.filename}:{place.lineno}"
    shown = printable(sentence)
    return f"no sentence: {shown[:200]}" if "Traceback" in shown or len(shown) > 2000 else "told"


def keys(cfg: DictConfig) -> list[str]:
    """Every node and leaf of a configuration, and the options of the chosen plugins, by dotted name."""
    found: list[str] = []

    def visit(node: DictConfig, where: str) -> None:
        for key in node:
            name = f"{where}{key}"
            if name == "hydra":
                continue
            found.append(name)
            child = node._get_node(key)
            if isinstance(child, DictConfig) and not child._is_none():
                visit(child, f"{name}.")

    visit(cfg, "")
    for section, kind in PLUGIN_SECTIONS.items():
        cls = registry().get(kind, cfg[section].name)
        found += [f"{section}.{option}" for option in options(cls, KINDS[kind].given)]
    found += [f"robot.{option}" for option in options(Robot)]
    found += [f"training.{option}" for option in options(TrainingSettings)]
    found += [f"trainer.{option}" for option in ("precision", "max_time", "logger", "callbacks", "strategy", "plugins")]
    found += ["callbacks.early_stopping", "objective.sparse_depth", "hydra.run.dir", "hydra.job.name"]
    return sorted(set(found))


def tasks_of(key: str) -> list[str]:
    """The tasks that read an option."""
    section = key.partition(".")[0]
    return [name for name, task in TASKS.items() if section in task.sections] or ["experiment"]


@pytest.fixture(scope="module")
def bases(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bases]:
    """What the cases change: a configuration for each task, with files that are there where it asks for some."""
    folder = tmp_path_factory.mktemp("values")
    settings = SMALL_MODELS["kbnet"]
    save_model(folder / "model.safetensors", registry().create("depth_models", "kbnet", settings), "kbnet", settings)
    points = np.zeros((48, 48), np.uint16)
    points[::6, ::6] = 512
    Image.fromarray(np.full((48, 48, 3), 90, np.uint8)).save(folder / "image.png")
    Image.fromarray(points).save(folder / "points.png")
    np.savetxt(folder / "K.txt", [[24.0, 0, 23.5], [0, 24.0, 23.5], [0, 0, 1]])
    files = {
        "predict": [f"predict.{name}={folder / file}" for name, file in FRAME.items()],
        "export": [f"export.checkpoint={folder}/model.safetensors"],
        "evaluate": [f"evaluation.checkpoint={folder}/model.safetensors"],
    }
    overrides = {task: (*BASE, f"task={task}", f"paths.outputs={folder}", *files.get(task, ())) for task in TASKS}
    make_trainer({"accelerator": "cpu", "logger": False})  # its imports take long, and no case may be cut off in them
    register_configuration()
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(config_folder()), job_name="deux", version_base="1.3"):
        loader = GlobalHydra.instance().config_loader()
        composed = {task: loader.load_configuration(CONFIG_NAME, list(overrides[task]), RUN) for task in TASKS}
        yield Bases(loader, overrides, composed)


@pytest.fixture
def stopped(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """Let no task open its run folder or make a dataset, nor take longer than its time."""

    def begun(*_: object, **__: object) -> None:
        raise Begun

    def late(*_: object) -> None:
        raise TimeoutError

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(HydraConfig, "initialized", lambda: False)
    monkeypatch.setattr(HydraConfig, "get", begun)
    monkeypatch.setattr(Datasets, "_build", begun)
    monkeypatch.setattr(SeedModel, "get", begun)
    earlier = signal.signal(signal.SIGALRM, late)
    yield
    signal.signal(signal.SIGALRM, earlier)


def failures(bases: Bases, kind: str, chosen: list[str]) -> dict[str, str]:
    """The cases of one kind of value that end neither in a sentence nor in a run that begins."""
    outcomes = {}
    for key in chosen:
        override = f"~{key}" if kind == DELETED else f"{key}={VALUES[kind].replace('KEY', key)}"
        task = random.Random(ascii(override)).choice(tasks_of(key))
        outcomes[f"task={task} {override[:80]}"] = outcome(bases, task, override)
    assert len(outcomes) == len(chosen)
    return {case: found for case, found in outcomes.items() if found not in ("begun", "told")}


@pytest.mark.filterwarnings("ignore")  # of Lightning's, over settings that it takes
@pytest.mark.parametrize("kind", [*VALUES, DELETED])
def test_a_sample_of_options_with_each_value(bases: Bases, stopped: None, kind: str) -> None:
    chosen = random.Random(kind).sample(keys(bases.composed["experiment"]), 6)
    assert failures(bases, kind, chosen) == {}


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", [*VALUES, DELETED])
def test_every_option_with_each_value(bases: Bases, stopped: None, kind: str) -> None:
    assert failures(bases, kind, keys(bases.composed["experiment"])) == {}


def test_the_generator_tells_a_fault_and_a_run_from_a_sentence(
    bases: Bases, stopped: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert outcome(bases, "collect", "collect.steps=12") == "begun"
    assert outcome(bases, "collect", "collect.steps=x") == "told"
    monkeypatch.setattr(CollectSettings, "__post_init__", lambda self: 1 / 0)
    assert outcome(bases, "collect", "collect.steps=12").startswith("ZeroDivisionError")
