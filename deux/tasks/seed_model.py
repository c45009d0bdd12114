"""The seed model: the depth model whose errors tell the explorer where to go."""

from dataclasses import replace
from pathlib import Path

from deux.collection.exploration import MODEL_NEEDS
from deux.contracts import DepthModel
from deux.tasks.datasets import explored_dataset
from deux.tasks.given import given_model, weights_identity
from deux.tasks.settings import PluginChoice, Settings
from deux.tasks.training import Trainee, train_once


def needs_model(explorer: PluginChoice) -> bool:
    """Whether the explorer asks for what only a depth model can give."""
    return bool(explorer.create().needs & MODEL_NEEDS)


def seed_model(settings: Settings, trainee: Trainee) -> tuple[DepthModel, str]:
    """The seed model in eval mode, and what identifies its weights.

    Args:
        settings: the run's.
        trainee: the final model's architecture and objective, which are the seed model's, too.

    It is `seed.checkpoint` if that is given: a run folder, a model file, or a file that the authors of the configured
    model published. Otherwise it is trained on a random agent's frames, with the final model's
    architecture and settings but for `seed.steps`, and kept under `outputs/seed_models` for every run that asks for
    the same.
    """
    checkpoint = settings.seed_model.checkpoint
    path = str(_trained(settings, trainee)) if checkpoint is None else checkpoint
    _, model = given_model(settings.model, path)
    return model, weights_identity(path)


def _trained(settings: Settings, trainee: Trainee) -> Path:
    dataset = explored_dataset(settings, settings.seed_explorer)
    training = replace(settings.training, steps=settings.seed_model.steps)
    return train_once(settings, trainee, training, dataset, "seed_models")
