"""Trained models that the user names by a path, and where they come from."""

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
"""Of the checkpoint files that the models' authors published."""

RESUME_SUFFIX = ".ckpt"
"""Of the files that a killed training goes on from; they hold no model that could be made without its run."""


def load_named_model(published: PluginChoice, path: str) -> tuple[str, DepthModel]:
    """A trained model's registered name, and the model in eval mode.

    Args:
        published: the model, with its options, whose authors published the file, if it is such a file.
        path: a run folder, a model file of ours, the name of a model that ships or a published checkpoint, as the user
            wrote it.

    Raises:
        DeuxError: there is no model there, or none that fits.
    """
    file = named_path(path)
    if file.suffix == PUBLISHED_SUFFIX:
        # The configuration sets these for models that are trained here: a published one has what its authors gave it.
        model_class: type[DepthModel] = registry().get("depth_models", published.name)
        fixed = model_class.published_options
        settings = {option: value for option, value in published.chosen.items() if option not in fixed}
        return published.name, load_published(published.name, file, settings=settings)
    if file.suffix == RESUME_SUFFIX:
        raise DeuxError(f"{file} is for resuming a training: name the {MODEL_FILE} of a run folder, or the folder.")
    return model_name(file), load_model(file)


def load_needed_model(published: PluginChoice, path: str | None, option: str) -> tuple[str, DepthModel]:
    """As `load_named_model`, for a task that cannot do without a model; `option` is the key that names it.

    Without a path it is the configuration's own model if that brings its trained weights.
    """
    if not path and is_pretrained(published):
        return published.name, published.create().eval()
    if not path:
        raise DeuxError(
            f"a trained model is needed: name a run folder, a model file, a model that ships or a published checkpoint "
            f"by {option}=."
        )
    return load_named_model(published, path)


def weights_identity(path: str | Path) -> str:
    """Sixteen hexadecimal digits that any change of a model file, or of a run folder's model file, changes."""
    return hashlib.sha256(weights_file(named_path(path)).read_bytes()).hexdigest()[:16]


def named_identity(published: PluginChoice, path: str | Path) -> str:
    """As `weights_identity`, of a model that is made with the options of `published` if its authors published the file.

    Such a file holds no options, and with others the same weights are another model.
    """
    weights = weights_identity(path)
    if named_path(path).suffix != PUBLISHED_SUFFIX:
        return weights
    return hashlib.sha256(json.dumps([weights, published.description], sort_keys=True).encode()).hexdigest()[:16]


def named_path(path: str | Path) -> Path:
    """The file or folder of a model as the user named it: by a path, or by the name of a model that ships."""
    return file_or_shipped(path, user_path(path))


def load_start(model: PluginChoice, path: str) -> DepthModel:
    """A trained model whose weights a training starts from (`training.start`).

    Args:
        model: what is to be trained.
        path: as of `load_named_model`.

    Raises:
        DeuxError: there is no model there, or it is another one or has other options.
    """
    name, trained = load_named_model(model, path)
    if name != model.name:
        raise DeuxError(f"training.start={path} is a {name}, and a {model.name} is to be trained: choose model={name}.")
    if different := _different_options(named_path(path), model.settings):
        raise DeuxError(
            f"training.start={path} was made with other options of {name} ({different}): set them alike, "
            "model.<option>=..., or start from other weights."
        )
    return trained


def check_foundation(foundation: PluginChoice, model: str, path: str) -> None:
    """Refuse a foundation (`foundation.checkpoint`) that another model than the one to be trained would be built on.

    Only its file is looked at: whether its weights fit is for who loads them to say.

    Args:
        foundation: what the model to be trained is built on. The options that were chosen for it count; the others,
            such as a margin, are of no account inside that model or change the shape of weights.
        model: registered name of the model to be trained.
        path: as of `load_named_model`.

    Raises:
        DeuxError: there is no model there, or it has other options.
    """
    file = weights_file(named_path(path))
    if file.suffix in (PUBLISHED_SUFFIX, RESUME_SUFFIX) or model_name(file) != foundation.name:
        return
    if different := _different_options(file, foundation.chosen):
        raise DeuxError(
            f"foundation.checkpoint={path} was made with other options of {foundation.name} ({different}) than the one "
            f"that {model} is built on: set those of {model} that make it alike, model.<option>=..., or name another."
        )


def _different_options(file: Path, settings: Mapping[str, Any]) -> str:
    """The options of a model file that are not as in `settings`, as "name=value, ..."; "" if all are.

    A published file holds none: it is read with those that are asked for.
    """
    theirs = settings if file.suffix == PUBLISHED_SUFFIX else model_config(file).settings
    return ", ".join(f"{key}={theirs.get(key)!r}" for key, value in settings.items() if theirs.get(key) != value)


def is_pretrained(model: PluginChoice) -> bool:
    """Whether a depth model brings its trained weights."""
    cls: type[DepthModel] = registry().get("depth_models", model.name)
    return cls.pretrained


def pretrained_identity(choice: PluginChoice, model: DepthModel) -> str:
    """As `weights_identity`, of a model that was made with its weights: of its name, options and tensors."""
    digest = hashlib.sha256(json.dumps(choice.description, sort_keys=True).encode())
    for name, value in model.state_dict().items():
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
        digest.update(value.detach().cpu().flatten().view(torch.uint8).numpy())
    return digest.hexdigest()[:16]


def provenance(path: str) -> dict[str, Any]:
    """Where a named model comes from, as `Results.trained` holds it."""
    file = weights_file(named_path(path))
    identity = read_identity(file.parent) if file.name == MODEL_FILE else None
    return {"weights": weights_identity(path), "settings": identity}


def find_trained_run(sections: Sections, path: str) -> str:
    """The run folder that a folder of runs holds for this command; any other path as it is.

    It is the run with this command's model, explorer, seed and budget, trained on another dataset if there is one.

    Raises:
        DeuxError: the folder has trained runs, but none of these, or several.
    """
    folder = user_path(path)
    if not folder.is_dir() or (folder / MODEL_FILE).exists():
        return path
    trained = {
        run: made_of for run in run_folders(folder) if (run / MODEL_FILE).exists() if (made_of := _trained_on(run))
    }
    if not trained:
        return path
    mine = conditions(sections.identity)
    fitting = {run: made_of for run, made_of in trained.items() if _same(made_of, mine)}
    elsewhere = [run for run, made_of in fitting.items() if made_of.testing != mine.testing]
    candidates = elsewhere or list(fitting)
    if len(candidates) == 1:
        return str(candidates[0])
    wanted = f"{mine.model} on {mine.explorer} frames with seed {mine.seed} and this budget"
    if not candidates:
        raise DeuxError(f"evaluation.checkpoint={path} has no trained run of {wanted} below it: train it first.")
    raise DeuxError(
        f"evaluation.checkpoint={path} has {len(candidates)} trained runs of {wanted} below it: name the folder of "
        f"one of them, such as {candidates[0]} or {candidates[1]}."
    )


def _trained_on(run: Path) -> Conditions | None:
    """What a run that trained a model on explored frames was made of."""
    identity = read_identity(run)
    if identity is None or identity.get("task") not in ("experiment", "train") or identity.get("training_data"):
        return None
    return conditions(identity)


def _same(one: Conditions, other: Conditions) -> bool:
    return (one.model, one.model_options, one.explorer, one.explorer_options, one.seed, one.budget) == (
        other.model,
        other.model_options,
        other.explorer,
        other.explorer_options,
        other.seed,
        other.budget,
    )
