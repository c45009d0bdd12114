"""The seed model: the depth model whose errors tell the explorer where to go."""

import hashlib
from dataclasses import asdict, replace
from pathlib import Path

from deux.configuration import user_path
from deux.contracts import DepthModel
from deux.data.exploration import MODEL_NEEDS
from deux.data.locking import locked
from deux.tasks.console import say
from deux.tasks.datasets import explored_dataset
from deux.tasks.given import given_model
from deux.tasks.run_folder import RunFolder, short_hash
from deux.tasks.settings import PluginChoice, Settings
from deux.tasks.training import train
from deux.training.model_files import MODEL_FILE


def needs_model(explorer: PluginChoice) -> bool:
    """Whether the explorer asks for what only a depth model can give."""
    return bool(explorer.create().needs & MODEL_NEEDS)


def seed_model(settings: Settings) -> tuple[DepthModel, str]:
    """The seed model in eval mode, and what identifies its weights.

    It is `seed.checkpoint` if that is given: a run folder, a model file, or a file that the authors of the configured
    model published. Otherwise it is trained on a random agent's frames, with the final model's
    architecture and settings but for `seed.steps`, and kept under `outputs/seed_models` for every run that asks for
    the same.
    """
    checkpoint = settings.seed_model.checkpoint
    path = _trained(settings) if checkpoint is None else user_path(checkpoint)
    _, model = given_model(settings, str(path))
    weights = path / MODEL_FILE if path.is_dir() else path
    return model, hashlib.sha256(weights.read_bytes()).hexdigest()[:16]


def _trained(settings: Settings) -> Path:
    dataset = explored_dataset(settings, settings.seed_explorer)
    training = replace(settings.training, steps=settings.seed_model.steps)
    identity = {
        "model": {"name": settings.model.name, **settings.model.settings},
        "objective": settings.objective,
        "pose": settings.run.pose,
        "training": asdict(training),
        "dataset": dataset.name,
        "random_seed": settings.seed,
    }
    folder = settings.outputs / "seed_models" / f"{settings.model.name}-{short_hash(identity)}"
    with locked(folder.with_name(f".{folder.name}.lock")):
        if (folder / MODEL_FILE).exists():
            say(f"  trained before: {folder}")
        else:
            train(settings, training, dataset, RunFolder(folder, identity))
    return folder / MODEL_FILE
