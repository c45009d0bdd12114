"""Commands for kill tests, which cover all tasks that write files."""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from deux.collection.perception import needs_model
from deux.contracts import FreeViewpoints
from deux.errors import DeuxError
from deux.policies.learned_explorer import LearnedExplorer
from deux.registry import PluginChoice, registry

SMALLEST = "experiment=smallest"
"""Preset of all scenarios: conf/experiment/smallest.yaml."""

_TRAINED = "outputs/trained"
"""Run folder of the training in `preparation`."""


@dataclass(frozen=True)
class Scenario:
    """A command for kill tests.

    Args:
        arguments: function that returns the options of the command, given the folder in which it runs.
        prepared: whether the folder contains the files of the command of `preparation`; otherwise it is empty.
        children: whether single processes of the command are killed as well, instead of all of them.
        varying: patterns of the files whose content differs between runs; see `left_files.digests`.
        modules: names of the packages that the command needs.
    """

    arguments: Callable[[Path], list[str]]
    prepared: bool = True
    children: bool = False
    varying: tuple[str, ...] = ()
    modules: tuple[str, ...] = ()

    @property
    def installed(self) -> bool:
        """Whether the required packages are installed."""
        return all(importlib.util.find_spec(module) is not None for module in self.modules)


def preparation() -> list[str]:
    """Options of the command that creates a dataset, test frames, a model and results for `prepared` scenarios."""
    return [SMALLEST, f"explore={_plain_explorer()}", "training.steps=2", f"hydra.run.dir={_TRAINED}"]


def _experiment(folder: Path) -> list[str]:
    return [SMALLEST]


def _rounds(folder: Path) -> list[str]:
    rounds = [f"callbacks.active_collection.{name}" for name in ("rounds=2", "steps=8")]
    # The seed model and its frames are those of the preparation.
    seed = [f"seed_model.explore={_plain_explorer()}", f"seed_model.checkpoint={_TRAINED}"]
    return [SMALLEST, "callbacks=[active_collection]", *rounds, *seed, "training.steps=12"]


def _explorer_training(folder: Path) -> list[str]:
    settings = {"scenes": 1, "steps": 384, "episode": 24, "environments": 2, "rollout": 32, "batch_size": 32}
    options = [f"explorer_training.{name}={value}" for name, value in settings.items()]
    few = ["explorer_training.epochs=1", "explorer_training.checkpoint=2"]
    return [SMALLEST, "task=train_explorer", f"explore={_learned_explorer()}", *options, *few]


def _collection(folder: Path) -> list[str]:
    return [SMALLEST, "task=collect", f"explore={_plain_explorer()}"]


def _processes(folder: Path) -> list[str]:
    return [*_collection(folder), "scenes.train=4", "collect.processes=2"]


def _ray(folder: Path) -> list[str]:
    workers = ["collect.executor=ray", "+collect.executor_options.workers=2"]
    return [*_collection(folder), "scenes.train=4", *workers]


def _prediction(folder: Path) -> list[str]:
    frames = [f"predict.data={_dataset(folder)}", "predict.uncertainty=hidden_points", "predict.export=[ply,glb]"]
    return [SMALLEST, "task=predict", f"predict.checkpoint={_TRAINED}", *frames, "predict.batch_size=2"]


def _export(folder: Path) -> list[str]:
    return [SMALLEST, "task=export", f"export.checkpoint={_TRAINED}"]


def _dataset_export(format: str) -> Scenario:
    def arguments(folder: Path) -> list[str]:
        source = [f"export_dataset.train={_dataset(folder)}", "export_dataset.output=exported"]
        return [SMALLEST, "task=export_dataset", f"export_dataset.format={format}", *source]

    return Scenario(arguments, varying=("*/exported.json",))  # contains the inode of the folder


def _report(folder: Path) -> list[str]:
    return [SMALLEST, "task=report", "report.runs=outputs", "report.keep=kept"]


def _together(folder: Path) -> list[str]:
    trainer = ["trainer.strategy=ddp", "trainer.devices=2", "training.batch_size=1", "training.steps=8"]
    minutes = "training.checkpoint_minutes=0.0001"  # at every step, so that checkpoints do not depend on time
    return [SMALLEST, "task=train", f"explore={_plain_explorer()}", minutes, *trainer]


SCENARIOS = {
    "experiment": Scenario(_experiment, prepared=False),
    "rounds": Scenario(_rounds),
    # Results differ, since episodes are restarted after a kill.
    "train_explorer": Scenario(
        _explorer_training, prepared=False, varying=("*/policy.safetensors", "*/checkpoint.pt", "*/figures/*")
    ),
    "collect": Scenario(_collection, prepared=False),
    "processes": Scenario(_processes, prepared=False, children=True),
    "ray": Scenario(_ray, prepared=False, modules=("ray",)),
    "predict": Scenario(_prediction),
    "export": Scenario(_export, modules=("onnx", "onnxscript", "onnxruntime")),
    "export_void": _dataset_export("void"),
    "export_triplets": _dataset_export("triplets"),
    "export_webdataset": _dataset_export("webdataset"),
    "report": Scenario(_report),
    # Training resumes within an epoch: checkpoints contain the number of starts, and unlogged steps are not plotted.
    "ddp": Scenario(_together, children=True, varying=("*/checkpoints/*", "*/figures/training.png")),
}
"""Scenarios by name."""


@cache
def _plain_explorer() -> str:
    """Name of the first installed explorer that needs no depth model and no trained policy."""
    return _first("moves without a depth model", lambda name: not (_is_learned(name) or needs_model(_choice(name))))


@cache
def _learned_explorer() -> str:
    """Name of the first installed learned explorer."""
    return _first("is learned", _is_learned)


def _first(what: str, fits: Callable[[str], bool]) -> str:
    for name in registry().names("explorers"):
        if not isinstance(_choice(name).create(), FreeViewpoints) and fits(name):
            return name
    raise DeuxError(f"no explorer is installed that {what}: this scenario needs one.")


def _choice(name: str) -> PluginChoice:
    return registry().choose("explorers", {"name": name})


def _is_learned(name: str) -> bool:
    explorer = registry().get("explorers", name)
    return isinstance(explorer, type) and issubclass(explorer, LearnedExplorer)


def _dataset(folder: Path) -> str:
    """Path of the dataset in a prepared folder, relative to the folder."""
    return next(folder.glob(f"outputs/datasets/{_plain_explorer()}-*")).relative_to(folder).as_posix()
