"""Trained depth models that are shipped with installed packages, and are loaded by name instead of a path.

A package declares them in `pyproject.toml`, and has the model files in the folder `weights/` of one of its modules:

    [project.entry-points."deux.weights"]
    my_models = "my_package.depth_models"

The name of a model is its file name without `.safetensors`. Its card is in an `.md` file of the same name; the file's
header contains it as well.
"""

import json
import logging
import os
from functools import cache
from importlib import resources
from os import PathLike
from pathlib import Path

from safetensors import SafetensorError, safe_open

from deux.registry import registry

log = logging.getLogger(__name__)

GROUP = "deux.weights"
"""The entry-point group."""

FOLDER = "weights"
"""Folder of the model files, in the package of an entry point."""

SUFFIX = ".safetensors"

CARD_KEY = "deux_card"
"""Key of a model's card (`deux.report.model_card`) in the header of its file, as JSON."""


def available() -> dict[str, str]:
    """The shipped depth models by name, each with a one-line summary.

    Example:
        >>> "kbnet-indoor" in available()
        True
    """
    return {name: _summary(file) for name, file in sorted(shipped_files().items())}


@cache
def shipped_files() -> dict[str, Path]:
    """The files of shipped models, by name.

    A package that cannot be imported is left out with a warning, and so is a second model of the same name.
    """
    files: dict[str, Path] = {}
    for entry in registry().entry_points(GROUP):
        try:
            folder = Path(str(resources.files(entry.value))) / FOLDER
        except Exception as error:  # this imports the third-party package, which may raise anything
            log.warning("the trained models of %s are left out, it cannot be imported: %s", entry.value, error)
            continue
        for file in sorted(folder.glob(f"*{SUFFIX}")):
            if file.stem in files:
                log.warning("there are two models called %s: %s is left out", file.stem, file)
            files.setdefault(file.stem, file)
    return files


def file_or_shipped(path: str | PathLike[str], absolute: Path) -> Path:
    """The path of a model that the user gave by path or by the name of a shipped model; existing paths take precedence.

    Args:
        path: the path or name as the user wrote it.
        absolute: the absolute path of `path`.
    """
    return absolute if os.path.exists(absolute) else shipped_files().get(str(path), absolute)


def _summary(file: Path) -> str:
    try:
        with safe_open(file, framework="np") as stream:
            return str(json.loads((stream.metadata() or {})[CARD_KEY])["summary"])
    except (SafetensorError, OSError, LookupError, TypeError, ValueError):
        return f"no description in {file}"
