"""The configuration as the objects that the stages take."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from omegaconf import DictConfig

from deux.configuration import user_path
from deux.contracts import Robot
from deux.data.sparse import SparseSettings
from deux.data.verification import VerificationSettings
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.options import construct, full_settings, plain
from deux.registry import registry
from deux.scenes.sources import SceneSplits, scene_splits
from deux.training.fit import TrainingSettings


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
    """A composed configuration, read and checked.

    Every part is made when it is first asked for; a mistake in it raises a DeuxError that names its place.

    Args:
        cfg: what Hydra composed.
    """

    def __init__(self, cfg: DictConfig) -> None:
        self.cfg = cfg
        self.seed = int(cfg.random_seed)
        self.outputs = user_path(cfg.paths.outputs)

    @property
    def identity(self) -> dict[str, Any]:
        """The whole configuration but for paths, plugin defaults included: what a run folder belongs to."""
        chosen = {str(key): plain(self.cfg[key], str(key)) for key in self.cfg if key not in ("hydra", "paths")}
        chosen["model"] = {"name": self.model.name, **self.model.settings}
        chosen["explore"] = {"name": self.explorer.name, **self.explorer.settings}
        return chosen

    @cached_property
    def camera(self) -> Camera:
        """The robot's camera."""
        return construct(Camera, self.cfg.camera, "camera")

    @cached_property
    def robot(self) -> Robot:
        """The robot's body."""
        return construct(Robot, self.cfg.robot, "robot")

    @cached_property
    def sparse(self) -> SparseSettings:
        """How sparse points are taken."""
        return construct(SparseSettings, self.cfg.sparse, "sparse")

    @cached_property
    def verification(self) -> VerificationSettings:
        """Which frames are rejected."""
        return construct(VerificationSettings, self.cfg.verification, "verification")

    @cached_property
    def splits(self) -> SceneSplits:
        """The scenes; paths are taken from where the command was started."""
        chosen = plain(self.cfg.scenes, "scenes")
        if chosen.get("source") == "files":
            chosen |= {split: _user_paths(chosen.get(split)) for split in ("train", "validation", "test")}
        return scene_splits(chosen)

    @cached_property
    def training(self) -> TrainingSettings:
        """How the final model is trained."""
        return construct(TrainingSettings, self.cfg.training, "training")

    @cached_property
    def model(self) -> PluginChoice:
        """The depth model."""
        return self._plugin("depth_models", self.cfg.model, "model")

    @cached_property
    def explorer(self) -> PluginChoice:
        """The explorer that collects the final model's frames."""
        return self._plugin("explorers", self.cfg.explore, "explore")

    @cached_property
    def seed_explorer(self) -> PluginChoice:
        """The explorer that collects the seed model's frames, with its default options."""
        if self.cfg.seed.explore == self.explorer.name:
            return self.explorer
        return self._plugin("explorers", {"name": self.cfg.seed.explore}, "seed.explore")

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

    @staticmethod
    def _plugin(kind: str, chosen: Any, where: str) -> PluginChoice:
        options = plain(chosen, where)
        name = options.pop("name", None)
        if name is None:
            raise DeuxError(f"{where}.name is missing: choose one with {where}=<name>.")
        return PluginChoice(kind, name, full_settings(registry().get(kind, name), options, where))


def _user_paths(paths: Any) -> list[str]:
    return [str(user_path(path)) for path in ([paths] if isinstance(paths, str) else paths or [])]
