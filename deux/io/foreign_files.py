"""Files that somebody else may have made, such as a run folder from a download: data, and never instructions."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

MOST_BYTES = 2**20
"""Size of a YAML file that is read; those of runs and sweeps have some thousand bytes."""

DEEPEST = 40
"""Levels of lists and mappings in a YAML file that is read."""


def read_yaml(path: Path) -> Any:
    """The content of a YAML file, of plain values only.

    References to options or to the environment, as in `${oc.env:HOME}`, stay the text that they are. Tags that make
    objects are refused, and so are anchors, by which a file of some hundred bytes can stand for billions of values.

    Args:
        path: the file, such as a run's `.hydra/config.yaml`.

    Raises:
        ValueError: it is no YAML of plain values, or too large or too deep; the message says which.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError(f"it has more than {MOST_BYTES} bytes")
    loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        _check_events(content, loader)
        return yaml.load(content, loader)
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error


def walk(folder: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """As `os.walk` from the top, by name and through links, but into no folder twice.

    Links that lead in circles would otherwise never end. Hidden folders are left out.

    Yields:
        A folder, the names of those in it, which the caller may remove names from, and the names of its files.
    """
    seen = set()
    for found, below, files in os.walk(folder, followlinks=True):
        state = os.stat(found)
        if (state.st_dev, state.st_ino) in seen:
            below.clear()
            continue
        seen.add((state.st_dev, state.st_ino))
        below[:] = sorted(name for name in below if not name.startswith("."))
        yield Path(found), below, files


def _check_events(content: bytes, loader: Any) -> None:
    """Raise ValueError over anchors and over too many levels, before any object is made of the content."""
    depth = 0
    for event in yaml.parse(content, loader):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise ValueError("it has YAML anchors")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise ValueError(f"it has more than {DEEPEST} levels")
