"""The seed model: the depth model whose uncertainty guides the explorer."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from deux.configuration import compose
from deux.contracts import DepthModel
from deux.errors import DeuxError, check_range
from deux.options import construct
from deux.plain_settings import plain
from deux.registry import PluginChoice, registry
from deux.task_sections import Sections
from deux.tasks.checkpoints import (
    PUBLISHED_SUFFIX,
    is_pretrained,
    load_named_model,
    named_identity,
    pretrained_identity,
    weights_identity,
)
from deux.tasks.console import say
from deux.tasks.datasets import Datasets, is_ceiling
from deux.tasks.model_training import Recipe, Training
from deux.training.training_settings import TrainingSettings


@dataclass(frozen=True)
class SeedModelSettings:
    """Options of the seed model.

    Args:
        name: an installed depth model; None for the final model with its options.
        checkpoint: a trained model to use, a path or the name of a shipped model; None trains one, unless the model is
            pretrained.
        explore: the explorer that collects its training frames; not free viewpoints, which no robot could collect.
        steps: optimiser steps of its training.
        source: scene source of the scenes in which that explorer collects, which are not among the experiment's; None
            for the experiment's training scenes.
        scenes: number of scenes of that source.
        options: options of the model `name` that differ from those of `model=<name>`.

    Raises:
        DeuxError: a value is out of its range.
    """

    name: str | None
    checkpoint: str | None
    explore: str
    steps: int
    source: str | None = None
    scenes: int = 8
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_range("seed_model.steps", self.steps, 1)
        check_range("seed_model.scenes", self.scenes, 1)
        if self.options and self.name is None:
            raise DeuxError(
                "seed_model.options have no effect without seed_model.name: set that, or change the final model's "
                "options, which the seed model shares, with model.<option>=."
            )
        file = self.checkpoint
        if self.name is not None and file is not None and not file.endswith(PUBLISHED_SUFFIX):
            raise DeuxError(
                f"seed_model.name={self.name} and seed_model.checkpoint={file} are two seed models: set "
                "seed_model.checkpoint=null to use the former, or leave out seed_model.name."
            )

    def choose(self, final: PluginChoice) -> PluginChoice:
        """The seed model's plugin and options: `final`, or the model `name`.

        Args:
            final: the final model.
        """
        if self.name is None or (self.name == final.name and not self.options):
            return final
        registry().find("depth_models", self.name)  # otherwise a wrong name would be reported for the option `model`
        configured = plain(compose([f"model={self.name}"]).model, "model")
        return registry().choose("depth_models", {**configured, **self.options}, "seed_model.options")

    def is_ready(self, chosen: PluginChoice) -> bool:
        """Whether no training is needed: there is a checkpoint, or the model chosen by `choose` is pretrained."""
        return self.checkpoint is not None or is_pretrained(chosen)

    def load(self, chosen: PluginChoice) -> "TrainedModel":
        """Load a seed model that needs no training (`is_ready`).

        Raises:
            DeuxError: there is no model at `checkpoint`, or it does not fit.
        """
        if self.checkpoint is not None:
            return TrainedModel(*load_named_model(chosen, self.checkpoint), named_identity(chosen, self.checkpoint))
        model = chosen.create().eval()
        return TrainedModel(chosen.name, model, pretrained_identity(chosen, model))


class TrainedModel(NamedTuple):
    """A trained depth model.

    Args:
        name: its registered name.
        model: the model, in eval mode.
        weights: identity of its weights, a hash.
    """

    name: str
    model: DepthModel
    weights: str


class SeedModel:
    """Trains the seed model, or loads it.

    Args:
        sections: configuration; reads `seed_model`, `explore` and, if the seed model is another model than the final
            one, `training`.
        datasets: datasets of the run.
        training: trains the seed model; its recipe is that of the final model.

    Raises:
        DeuxError: an option is wrong.
    """

    def __init__(self, sections: Sections, datasets: Datasets, training: Training) -> None:
        self.settings = sections.read("seed_model", SeedModelSettings)
        self._datasets = datasets
        self._training = training
        if self.settings.source is not None:
            registry().choose("scenes", {"name": self.settings.source}, "seed_model.source")
        explorer = sections.plugin("explore")
        if self.settings.checkpoint is None and self.settings.explore != explorer.name:
            explorer = registry().choose("explorers", {"name": self.settings.explore}, "seed_model.explore")
        self._explorer = explorer
        if self.settings.checkpoint is None and is_ceiling(explorer):
            raise DeuxError(
                f"seed_model.explore={self.settings.explore} stands for free viewpoints, which no robot can collect: "
                "choose another explorer."
            )
        final = training.recipe
        model = self.settings.choose(final.model)
        if model is final.model:
            self._recipe = final
        else:
            self._recipe = _other_recipe(model, final, sections.plain("training"))
            if not is_pretrained(model):
                self._recipe.check()

    @property
    def description(self) -> str:
        """One-line description, for the console."""
        if self.settings.checkpoint is not None:
            return f"Seed model: {self.settings.checkpoint}"
        if is_pretrained(self._recipe.model):
            return f"Seed model: {self._recipe.model.name}, pretrained"
        scenes = "" if self.settings.source is None else f" of {self.settings.scenes} further {self.settings.source}"
        return f"Seed model: {self._recipe.model.name} on the {self._explorer.name} frames{scenes}"

    def get(self) -> TrainedModel:
        """Load or train the seed model.

        `seed_model.checkpoint` is loaded if it is set: a run folder, a model file or a published checkpoint. A
        pretrained model is used unchanged. Otherwise the model is trained on the frames of `seed_model.explore` and
        saved under `outputs/seed_models`, where all runs with the same settings share it. Like those of a foundation,
        frames of `seed_model.source` do not count towards the robot's budget of steps in the explored scenes.
        """
        say(self.description)
        if self.settings.is_ready(self._recipe.model):
            return self.settings.load(self._recipe.model)
        path = self._train()
        return TrainedModel(*load_named_model(self._recipe.model, path), weights_identity(path))

    def _train(self) -> str:
        training = replace(self._recipe.training, steps=self.settings.steps)
        source = self.settings.source
        if source is None:
            frames = self._datasets.explored(self._explorer)
        else:
            frames = self._datasets.explored_elsewhere(self._explorer, source, self.settings.scenes)
        return str(self._training.train_once(replace(self._recipe, training=training), frames, "seed_models"))


def _other_recipe(model: PluginChoice, final: Recipe, training: dict[str, Any]) -> Recipe:
    """The recipe of a seed model other than the final model: its own objective and training defaults.

    Published learning rates differ between models, and a network may not learn at all with another one's. Training
    options that differ from the final model's defaults, as set by a preset or the user, apply to both models.
    """
    seed_config, final_config = (compose([f"model={name}"]) for name in (model.name, final.model.name))
    seed_defaults, final_defaults = (plain(config.training, "training") for config in (seed_config, final_config))
    settings = dict(training)
    for option in seed_defaults | final_defaults:
        if training.get(option) == final_defaults.get(option):
            settings.pop(option, None)
            settings |= {option: seed_defaults[option]} if option in seed_defaults else {}
    objective = plain(seed_config.objective, "objective")
    return Recipe(model, objective, final.pose, construct(TrainingSettings, settings, "training"))
