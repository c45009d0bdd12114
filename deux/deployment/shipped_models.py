"""Trained depth models that packages bring, by name in place of a path.

A package declares its own in `pyproject.toml`, and has them as model files in the folder `weights/` of a package:

    [project.entry-points."deux.weights"]
    my_models = "my_package.depth_models"

The name of a model is its file's without `.safetensors`. Beside it lies its card, `.md`, whose first line of text the
file's header holds, too.
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
"""Of model files, in the package that an entry names."""

SUFFIX = ".safetensors"

CARD_KEY = "deux_card"
"""Where a model file's header holds its card (`deux.report.model_card`) as JSON."""


def available() -> dict[str, str]:
    """The depth models that are installed with their weights, each with a line that says what it is.

    Example:
        >>> "kbnet-indoor" in available()
        True
    """
    return {name: _summary(file) for name, file in sorted(shipped_files().items())}


@cache
def shipped_files() -> dict[str, Path]:
    """The model files that packages bring, by the models' names.

    A package that cannot be imported is left out with a warning, and so is a second model of one name.
    """
    found: dict[str, Path] = {}
    for entry in registry().entry_points(GROUP):
        try:
            folder = Path(str(resources.files(entry.value))) / FOLDER
        except Exception as error:  # the foreign package is imported here, which may raise anything
            log.warning("the trained models of %s are left out, it cannot be imported: %s", entry.value, error)
            continue
        for file in sorted(folder.glob(f"*{SUFFIX}")):
            if file.stem in found:
                log.warning("there are two models called %s: %s is left out", file.stem, file)
            found.setdefault(file.stem, file)
    return found


def file_or_shipped(path: str | PathLike[str], absolute: Path) -> Path:
    """Where a model lies that is named by a path or by the name of one that ships; what exists goes before a name.

    Args:
        path: as the user wrote it.
        absolute: the path that this means if it is one.
    """
    return absolute if os.path.exists(absolute) else shipped_files().get(str(path), absolute)


def _summary(file: Path) -> str:
    try:
        with safe_open(file, framework="np") as stream:
            return str(json.loads((stream.metadata() or {})[CARD_KEY])["summary"])
    except (SafetensorError, OSError, LookupError, TypeError, ValueError):
        return f"no description in {file}"
