"""Loading of trained models that the user gives by path or name, and their provenance."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from deux.configuration import user_path
from deux.contracts import DepthModel
from deux.deployment.model_files import MODEL_FILE, load_model, model_config, model_name, weights_file
from deux.deployment.published_checkpoints import load_published
from deux.deployment.shipped_models import file_or_shipped
from deux.errors import DeuxError
from deux.registry import PluginChoice, registry
from deux.report.conditions import Conditions, conditions
from deux.report.runs import read_identity, run_folders
from deux.task_sections import Sections

PUBLISHED_SUFFIX = ".pth"
"""Suffix of the checkpoints that the models' authors published."""

RESUME_SUFFIX = ".ckpt"
"""Suffix of Lightning's checkpoints, which only resume a training: a model cannot be made from them alone."""


def load_named_model(published: PluginChoice, path: str) -> tuple[str, DepthModel]:
    """Load a trained model: its registered name, and the model in eval mode.

    Args:
        published: the model with its options, in case the file is a published checkpoint.
        path: a run folder, a model file, the name of a shipped model or a published checkpoint, as the user wrote it.

    Raises:
        DeuxError: there is no model at `path`, or it does not fit.
    """
    file = model_path(path)
    if file.suffix == PUBLISHED_SUFFIX:
        # The configuration sets these options for models trained here; published checkpoints have the authors' values.
        model_class: type[DepthModel] = registry().get("depth_models", published.name)
        fixed = model_class.published_options
        settings = {option: value for option, value in published.chosen.items() if option not in fixed}
        return published.name, load_published(published.name, file, settings=settings)
    if file.suffix == RESUME_SUFFIX:
        raise DeuxError(f"{file} is for resuming a training: give the {MODEL_FILE} of a run folder, or the folder.")
    return model_name(file), load_model(file)


def load_required_model(published: PluginChoice, path: str | None, option: str) -> tuple[str, DepthModel]:
    """Like `load_named_model`; without a path, the configured model, which must be pretrained.

    Args:
        published: as in `load_named_model`.
        path: as in `load_named_model`, or None.
        option: the option that gives the path, for the error message.

    Raises:
        DeuxError: there is no path, and the configured model has no pretrained weights; or as in `load_named_model`.
    """
    if not path and is_pretrained(published):
        return published.name, published.create().eval()
    if not path:
        raise DeuxError(
            f"a trained model is needed: set {option}= to a run folder, a model file, the name of a shipped model or a "
            "published checkpoint."
        )
    return load_named_model(published, path)


def weights_identity(path: str | Path) -> str:
    """Hash of a model file, or of the model file in a run folder: 16 hexadecimal digits."""
    return hashlib.sha256(weights_file(model_path(path)).read_bytes()).hexdigest()[:16]


def named_identity(published: PluginChoice, path: str | Path) -> str:
    """Like `weights_identity`, but for a published checkpoint, it also depends on the model's options.

    Such a file contains no options, and the same weights with other options are another model.
    """
    weights = weights_identity(path)
    if model_path(path).suffix != PUBLISHED_SUFFIX:
        return weights
    return hashlib.sha256(json.dumps([weights, published.description], sort_keys=True).encode()).hexdigest()[:16]


def model_path(path: str | Path) -> Path:
    """The file or folder of a model that the user gave by path or by the name of a shipped model."""
    return file_or_shipped(path, user_path(path))


def load_start(model: PluginChoice, path: str) -> DepthModel:
    """A trained model whose weights a training starts from (`training.start`).

    Args:
        model: the model to be trained.
        path: as in `load_named_model`.

    Raises:
        DeuxError: there is no model at `path`, or its name or options differ.
    """
    name, trained = load_named_model(model, path)
    if name != model.name:
        raise DeuxError(f"training.start={path} is a {name}, and a {model.name} is to be trained: choose model={name}.")
    if different := _different_options(model_path(path), model.settings):
        raise DeuxError(
            f"training.start={path} was made with other options of {name} ({different}): set the same ones with "
            "model.<option>=..., or start from other weights."
        )
    return trained


def check_foundation(foundation: PluginChoice, model: str, path: str) -> None:
    """Raise DeuxError if the options of `foundation.checkpoint` differ from what the model to be trained needs.

    Only the file's configuration is read; whether its weights fit is checked when they are loaded.

    Args:
        foundation: the foundation that the model needs. Only its explicitly chosen options are compared; the others
            have no effect inside that model, or change the shapes of weights.
        model: registered name of the model to be trained.
        path: as in `load_named_model`.

    Raises:
        DeuxError: there is no model at `path`, or it has other options.
    """
    file = weights_file(model_path(path))
    if file.suffix in (PUBLISHED_SUFFIX, RESUME_SUFFIX) or model_name(file) != foundation.name:
        return
    if different := _different_options(file, foundation.chosen):
        raise DeuxError(
            f"foundation.checkpoint={path} was made with other options of {foundation.name} ({different}) than {model} "
            f"needs: change the options of {model} with model.<option>=..., or choose another checkpoint."
        )


def _different_options(file: Path, settings: Mapping[str, Any]) -> str:
    """The options of a model file that differ from `settings`, as "name=value, ..."; "" if none do.

    Published checkpoints contain no options, so none differ.
    """
    stored = settings if file.suffix == PUBLISHED_SUFFIX else model_config(file).settings
    return ", ".join(f"{key}={stored.get(key)!r}" for key, value in settings.items() if stored.get(key) != value)


def is_pretrained(model: PluginChoice) -> bool:
    """Whether a depth model comes with trained weights."""
    cls: type[DepthModel] = registry().get("depth_models", model.name)
    return cls.pretrained


def pretrained_identity(choice: PluginChoice, model: DepthModel) -> str:
    """Like `weights_identity`, for a pretrained model: a hash of its name, options and tensors."""
    digest = hashlib.sha256(json.dumps(choice.description, sort_keys=True).encode())
    for name, value in model.state_dict().items():
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
        digest.update(value.detach().cpu().flatten().view(torch.uint8).numpy())
    return digest.hexdigest()[:16]


def provenance(path: str) -> dict[str, Any]:
    """The provenance of a trained model, as stored in `Results.trained`."""
    file = weights_file(model_path(path))
    identity = read_identity(file.parent) if file.name == MODEL_FILE else None
    return {"weights": weights_identity(path), "settings": identity}


def find_trained_run(sections: Sections, path: str) -> str:
    """Find the run with this command's model, explorer, seed and budget below a folder of runs.

    A run that was trained on another dataset than the one to test on is preferred. Other paths are returned unchanged.

    Raises:
        DeuxError: the folder contains trained runs, but no or several matching ones.
    """
    folder = user_path(path)
    if not folder.is_dir() or (folder / MODEL_FILE).exists():
        return path
    trained = {
        run: condition
        for run in run_folders(folder)
        if (run / MODEL_FILE).exists() and (condition := _training_conditions(run))
    }
    if not trained:
        return path
    wanted = conditions(sections.identity)
    matching = {run: condition for run, condition in trained.items() if _same_training(condition, wanted)}
    transferred = [run for run, condition in matching.items() if condition.testing != wanted.testing]
    candidates = transferred or list(matching)
    if len(candidates) == 1:
        return str(candidates[0])
    description = f"{wanted.model} on {wanted.explorer} frames with seed {wanted.seed} and this budget"
    if not candidates:
        raise DeuxError(f"evaluation.checkpoint={path} has no trained run of {description} below it: train it first.")
    raise DeuxError(
        f"evaluation.checkpoint={path} has {len(candidates)} trained runs of {description} below it: give the folder "
        f"of one of them, such as {candidates[0]} or {candidates[1]}."
    )


def _training_conditions(run: Path) -> Conditions | None:
    """The conditions of a run that trained a model on explored frames; None for other runs."""
    identity = read_identity(run)
    if identity is None or identity.get("task") not in ("experiment", "train") or identity.get("training_data"):
        return None
    return conditions(identity)


def _same_training(one: Conditions, other: Conditions) -> bool:
    names = ("model", "model_options", "explorer", "explorer_options", "seed", "budget")
    return all(getattr(one, name) == getattr(other, name) for name in names)
