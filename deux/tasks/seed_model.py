"""The seed model: the depth model whose errors tell the explorer where to go."""

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
    """The model whose errors guide the explorer.

    Args:
        name: any installed depth model; None for the final model's kind and options.
        checkpoint: a trained model to take, a path or the name of one that ships; None trains one, unless the model
            brings its weights.
        explore: the explorer that collects its frames; no free viewpoints, which no robot could collect.
        steps: optimiser steps of its training.
        source: of the scenes that this explorer is in: a scene source, none of whose scenes are the experiment's, or
            None for the experiment's own training scenes.
        scenes: number of the source's scenes.
        options: of the constructor of the model that `name` names, where they differ from what `model=<name>` has.

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
                "seed_model.options are of the model that seed_model.name names, and it names none: the seed model has "
                "the final model's options then, model.<option>=."
            )
        file = self.checkpoint
        if self.name is not None and file is not None and not file.endswith(PUBLISHED_SUFFIX):
            raise DeuxError(
                f"seed_model.name={self.name} and seed_model.checkpoint={file} are two seed models: set "
                "seed_model.checkpoint=null to have the one that is named, or leave the name out."
            )

    def choose(self, final: PluginChoice) -> PluginChoice:
        """The depth model that is made where there is no checkpoint, or that `checkpoint` is published for.

        Args:
            final: the depth model that is trained in the end.
        """
        if self.name is None or (self.name == final.name and not self.options):
            return final
        registry().find("depth_models", self.name)  # or it would be told as a mistake in `model`
        configured = plain(compose([f"model={self.name}"]).model, "model")
        return registry().choose("depth_models", {**configured, **self.options}, "seed_model.options")

    def is_ready(self, chosen: PluginChoice) -> bool:
        """Whether it takes no training: there is a checkpoint, or the model chosen by `choose` brings its weights."""
        return self.checkpoint is not None or is_pretrained(chosen)

    def load(self, chosen: PluginChoice) -> "TrainedModel":
        """The seed model that is ready.

        Raises:
            DeuxError: there is no model where `checkpoint` says, or none that fits.
        """
        if self.checkpoint is not None:
            return TrainedModel(*load_named_model(chosen, self.checkpoint), named_identity(chosen, self.checkpoint))
        model = chosen.create().eval()
        return TrainedModel(chosen.name, model, pretrained_identity(chosen, model))


class TrainedModel(NamedTuple):
    """A depth model and where it comes from.

    Args:
        name: its registered name.
        model: in eval mode.
        weights: what identifies its weights.
    """

    name: str
    model: DepthModel
    weights: str


class SeedModel:
    """Trains the seed model, or loads it.

    Args:
        sections: of these it reads `seed_model`, `explore` and, to adopt the training of another model, `training`.
        datasets: of the run.
        training: of the final model; its recipe is the seed model's too, unless that is of another kind.

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
                f"seed_model.explore is {self.settings.explore}, but a seed model is trained on what a robot collects, "
                "and free viewpoints are a ceiling that none can: choose another explorer."
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
        """What it is, for the console."""
        if self.settings.checkpoint is not None:
            return f"Seed model: {self.settings.checkpoint}"
        if is_pretrained(self._recipe.model):
            return f"Seed model: {self._recipe.model.name}, which is trained already"
        place = "" if self.settings.source is None else f" of {self.settings.scenes} further {self.settings.source}"
        return f"Seed model: {self._recipe.model.name} on the {self._explorer.name} frames{place}"

    def get(self) -> TrainedModel:
        """The seed model.

        It is `seed_model.checkpoint` if that is given: a run folder, a model file, or a file that the authors of the
        model published. A model that brings its weights is taken as it is. Otherwise it is trained on the frames of
        `seed_model.explore` and kept under `outputs/seed_models` for every run that asks for the same. Frames of
        `seed_model.source` cost the robot no step in the scenes that it explores and are no part of its budget, as
        those of a foundation are not.
        """
        say(self.description)
        if self.settings.is_ready(self._recipe.model):
            return self.settings.load(self._recipe.model)
        path = self._trained()
        return TrainedModel(*load_named_model(self._recipe.model, path), weights_identity(path))

    def _trained(self) -> str:
        training = replace(self._recipe.training, steps=self.settings.steps)
        source = self.settings.source
        if source is None:
            frames = self._datasets.explored(self._explorer)
        else:
            frames = self._datasets.explored_elsewhere(self._explorer, source, self.settings.scenes)
        return str(self._training.train_once(replace(self._recipe, training=training), frames, "seed_models"))


def _other_recipe(model: PluginChoice, final: Recipe, training: dict[str, Any]) -> Recipe:
    """The recipe of another depth model: its own objective, and of the training what its configuration changes.

    The published learning rates differ between models, and at another one's a network may not learn at all. What a
    preset or the user has set is for both.
    """
    mine, theirs = (compose([f"model={name}"]) for name in (model.name, final.model.name))
    own, others = (plain(one.training, "training") for one in (mine, theirs))
    settings = dict(training)
    for option in own | others:
        if training.get(option) == others.get(option):  # as the final model's configuration has it
            settings.pop(option, None)
            settings |= {option: own[option]} if option in own else {}
    objective = plain(mine.objective, "objective")
    return Recipe(model, objective, final.pose, construct(TrainingSettings, settings, "training"))
