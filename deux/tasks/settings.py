"""The configuration as the objects that the stages take."""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import torch
from omegaconf import DictConfig

from deux.collection.sparse import SparseSettings
from deux.collection.verification import VerificationSettings
from deux.configuration import NO_PART_OF_A_RUN, in_sweep, user_path
from deux.contracts import Robot
from deux.deployment.model_files import weights_file
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.options import construct, full_settings, plain
from deux.registry import registry
from deux.scenes.sources import SceneSplits, scene_splits
from deux.tasks.sections import (
    ActiveCollectionSettings,
    CollectSettings,
    CompareSettings,
    EvaluationSettings,
    ExplorerTrainingSettings,
    ExportSettings,
    FoundationSettings,
    PredictionSettings,
    RunSettings,
    SeedSettings,
)
from deux.training.fit import TrainingSettings, make_trainer
from deux.training.objective import make_objective
from deux.training.pose_source import make_pose_source
from deux.training.ranks import starts_the_command_again


@dataclass(frozen=True)
class PluginChoice:
    """A plugin and all its options.

    Args:
        kind: the registry's name of its kind.
        name: its registered name.
        settings: every option, defaults included; JSON values.
    """

    kind: str
    name: str
    settings: dict[str, Any]

    def create(self) -> Any:
        """Make the plugin; each call makes a new one."""
        return registry().create(self.kind, self.name, self.settings)


class Settings:
    """A composed configuration, read and checked: what is wrong in it shows before any work is done.

    Args:
        cfg: what Hydra composed.

    Raises:
        DeuxError: an option is unknown, of another type or out of its range.
    """

    def __init__(self, cfg: DictConfig) -> None:
        self.cfg = cfg
        self.outputs = user_path(cfg.paths.outputs)
        self.run = construct(RunSettings, {f.name: cfg[f.name] for f in fields(RunSettings)}, "")
        self.seed = self.run.random_seed
        self.camera = construct(Camera, cfg.camera, "camera")
        self.robot = construct(Robot, cfg.robot, "robot")
        self.collect = construct(CollectSettings, cfg.collect, "collect")
        self.sampling = construct(SparseSettings, cfg.sampling, "sampling")
        self.verification = construct(VerificationSettings, cfg.verification, "verification")
        self.seed_model = construct(SeedSettings, cfg.seed, "seed")
        self.foundation = construct(FoundationSettings, cfg.foundation, "foundation")
        self.explorer_training = construct(ExplorerTrainingSettings, cfg.explorer_training, "explorer_training")
        self.compare = construct(CompareSettings, cfg.compare, "compare")
        self.training = construct(TrainingSettings, cfg.training, "training")
        active = cfg.get("callbacks")  # there only if the group was chosen
        self.active = construct(ActiveCollectionSettings, active, "callbacks") if active is not None else None
        self.evaluation = construct(EvaluationSettings, cfg.evaluation, "evaluation")
        self.prediction = construct(PredictionSettings, {f.name: cfg[f.name] for f in fields(PredictionSettings)}, "")
        self.export = construct(ExportSettings, cfg.export, "export")
        self.model = plugin_choice("depth_models", cfg.model, "model")
        self.explorer = plugin_choice("explorers", cfg.explore, "explore")
        self.splits = self._splits()
        self._try_out()

    @property
    def identity(self) -> dict[str, Any]:
        """The configuration of what the run is, plugin defaults included: what a run folder belongs to."""
        chosen = {str(key): plain(self.cfg[key], str(key)) for key in self.cfg if key not in NO_PART_OF_A_RUN}
        chosen["model"] = {"name": self.model.name, **self.model.settings}
        chosen["explore"] = {"name": self.explorer.name, **self.explorer.settings}
        return chosen

    @cached_property
    def seed_explorer(self) -> PluginChoice:
        """The explorer that collects the seed model's frames, with its default options."""
        if self.seed_model.explore == self.explorer.name:
            return self.explorer
        return plugin_choice("explorers", {"name": self.seed_model.explore}, "seed.explore")

    @property
    def objective(self) -> dict[str, Any]:
        """Loss terms that override the model's own."""
        overrides: dict[str, Any] = plain(self.cfg.objective, "objective")
        return overrides

    @property
    def trainer(self) -> dict[str, Any]:
        """Arguments of Lightning's Trainer."""
        arguments: dict[str, Any] = plain(self.cfg.trainer, "trainer")
        return arguments

    def _splits(self) -> SceneSplits:
        """The scenes, of which a task needs those it works on; paths are taken from where the command was started."""
        chosen = plain(self.cfg.scenes, "scenes")
        if chosen.get("source") == "files":
            chosen |= {split: _user_paths(chosen.get(split)) for split in ("train", "validation", "test")}
        if self.run.task == "compare_explorers" and type(chosen.get("test")) is int:
            chosen["test"] = self.compare.flats
        needed = {
            "collect": ("train",),
            "train": () if self.run.training_data and self.active is None else ("train",),
            "evaluate": () if self.evaluation.data else ("test",),
            "predict": (),
            "export": (),
            "compare_explorers": ("test",),
            "train_explorer": ("train",) if self.explorer_training.flats is None else (),
        }
        return scene_splits(chosen, needed.get(self.run.task, ("train", "test")))

    def _try_out(self) -> None:
        """Make everything once that only later stages need, and drop it."""
        self.explorer.create()
        with torch.device("meta"):  # no memory, no time
            model = self.model.create()
            make_objective(model, self.objective)
            make_pose_source(self.run.pose, model)
        if model.foundation() is not None and self.foundation.checkpoint is not None:
            weights_file(user_path(self.foundation.checkpoint))
        trainer = make_trainer({"logger": False, "enable_checkpointing": False, **self.trainer})
        if in_sweep() and starts_the_command_again(trainer):
            raise DeuxError(
                f"a sweep (-m) with trainer.devices={trainer.num_devices} would start the whole sweep again in every "
                "process: give each job one device, or run the jobs one by one without -m."
            )


def plugin_choice(kind: str, chosen: Any, where: str) -> PluginChoice:
    """A plugin with all its options, defaults filled in.

    Args:
        kind: the registry's name of its kind.
        chosen: its "name" and the options that are not left at their defaults.
        where: their place in the configuration; it begins every message.

    Raises:
        DeuxError: there is no name, no such plugin, or an option that it does not have.
    """
    options = plain(chosen, where)
    name = options.pop("name", None)
    if name is None:
        raise DeuxError(f"{where}.name is missing: choose one with {where}=<name>.")
    return PluginChoice(kind, name, full_settings(registry().get(kind, name), options, where))


def _user_paths(paths: Any) -> list[str]:
    return [str(user_path(path)) for path in ([paths] if isinstance(paths, str) else paths or [])]
