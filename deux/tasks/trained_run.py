"""Which run's model `task=evaluate` takes, and what becomes known of how it was trained."""

from pathlib import Path
from typing import Any

from deux.configuration import user_path
from deux.deployment.model_files import MODEL_FILE, weights_file
from deux.errors import DeuxError
from deux.report.conditions import Conditions, conditions
from deux.report.runs import read_identity, run_folders
from deux.tasks.given import weights_identity
from deux.tasks.settings import Settings


def chosen_model(settings: Settings, path: str) -> str:
    """The run folder that a folder of runs holds for this command; any other path as it is.

    It is the run with this command's model, explorer, seed and budget, trained on another dataset if there is one.

    Raises:
        DeuxError: the folder has trained runs, but none of these, or several.
    """
    folder = user_path(path)
    if not folder.is_dir() or (folder / MODEL_FILE).exists():
        return path
    trained = {
        run: identity for run in run_folders(folder) if (run / MODEL_FILE).exists() if (identity := _made_of(run))
    }
    if not trained:
        return path
    mine = conditions(settings.identity)
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


def provenance(path: str) -> dict[str, Any]:
    """Where a given model comes from, as `Results.trained` holds it."""
    file = weights_file(user_path(path))
    identity = read_identity(file.parent) if file.name == MODEL_FILE else None
    return {"weights": weights_identity(path), "settings": identity}


def _made_of(run: Path) -> Conditions | None:
    """What a run that trained a model was made of."""
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
