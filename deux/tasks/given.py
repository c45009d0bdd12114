"""What the user names by its path: datasets and trained models."""

from pathlib import Path

from deux.configuration import user_path
from deux.contracts import DepthModel
from deux.errors import DeuxError
from deux.tasks.settings import Settings
from deux.training.model_files import MODEL_FILE, load_model, model_name
from deux.training.published import load_published

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


def given_model(settings: Settings, path: str) -> tuple[str, DepthModel]:
    """A trained model's registered name, and the model in eval mode.

    Args:
        settings: the run's; they name the model whose authors published the file, if it is such a file.
        path: a run folder, a model file of ours or a published checkpoint, as the user wrote it.

    Raises:
        DeuxError: there is no model there, or none that fits.
    """
    file = user_path(path)
    if file.suffix == PUBLISHED_SUFFIX:
        return settings.model.name, load_published(settings.model.name, file, settings=settings.model.settings)
    if file.suffix == RESUME_SUFFIX:
        raise DeuxError(f"{file} is for resuming a training: name the {MODEL_FILE} of a run folder, or the folder.")
    return model_name(file), load_model(file)
