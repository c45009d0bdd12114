"""What the user names by its path: datasets and trained models."""

import hashlib
from pathlib import Path

from deux.configuration import user_path
from deux.contracts import DepthModel
from deux.deployment.model_files import MODEL_FILE, load_model, model_name, weights_file
from deux.deployment.published_checkpoints import load_published
from deux.errors import DeuxError
from deux.tasks.settings import PluginChoice, Settings

PUBLISHED_SUFFIX = ".pth"
"""Of the checkpoint files that the models' authors published."""

RESUME_SUFFIX = ".ckpt"
"""Of the files that a killed training goes on from; they hold no model that could be made without its run."""


def given_dataset(option: str, path: str) -> Path:
    """The folder of a dataset.

    Args:
        option: the configuration's key that names it, for the message.
        path: as the user wrote it.

    Raises:
        DeuxError: it is no dataset.
    """
    folder = user_path(path)
    if not (folder / "data").is_dir():
        raise DeuxError(f"{option}={path} is no dataset: {folder} has no folder data/ with sequences in VOID's layout.")
    return folder


def needed_model(settings: Settings, option: str, path: str | None) -> tuple[str, DepthModel]:
    """As `given_model`, for a task that cannot do without; `option` is the configuration's key that names the model."""
    if not path:
        raise DeuxError(
            f"task={settings.run.task} needs a trained model: name a run folder, a model file or a published "
            f"checkpoint by {option}=."
        )
    return given_model(settings.model, path)


def given_model(published: PluginChoice, path: str) -> tuple[str, DepthModel]:
    """A trained model's registered name, and the model in eval mode.

    Args:
        published: the model, with its options, whose authors published the file, if it is such a file.
        path: a run folder, a model file of ours or a published checkpoint, as the user wrote it.

    Raises:
        DeuxError: there is no model there, or none that fits.
    """
    file = user_path(path)
    if file.suffix == PUBLISHED_SUFFIX:
        return published.name, load_published(published.name, file, settings=published.settings)
    if file.suffix == RESUME_SUFFIX:
        raise DeuxError(f"{file} is for resuming a training: name the {MODEL_FILE} of a run folder, or the folder.")
    return model_name(file), load_model(file)


def weights_identity(path: str | Path) -> str:
    """Sixteen hexadecimal digits that any change of a model file, or of a run folder's model file, changes."""
    return hashlib.sha256(weights_file(user_path(path)).read_bytes()).hexdigest()[:16]
