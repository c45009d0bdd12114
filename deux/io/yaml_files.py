"""YAML files from outside, as plain values: nothing in them is executed or resolved."""

from pathlib import Path
from typing import Any

import yaml

from deux.errors import DeuxError
from deux.io.arrays import said
from deux.io.atomic import read_bytes

MOST_BYTES = 2**20
"""Size of a file that is read; a composed configuration has some thousand bytes."""

DEEPEST = 40
"""Levels of lists and mappings in a file that is read."""

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(path: Path) -> Any:
    """Read a YAML file of plain values: mappings, lists, text, numbers, true and false, null and dates.

    References to options or to the environment, as in `${oc.env:HOME}`, stay the text that they are. Neither deux nor
    Hydra writes anchors, by which a few hundred bytes can stand for more values than there is memory for.

    Raises:
        DeuxError: the file is missing, is no such YAML, has anchors, more than `DEEPEST` levels or more than
            `MOST_BYTES`.
    """
    content = read_bytes(path)
    if len(content) > MOST_BYTES:
        raise DeuxError(f"{path} has more than {MOST_BYTES:,} bytes, which is no file of deux or Hydra.")
    try:
        problem = _problem(content)
        value = None if problem else yaml.load(content, _LOADER)
    except Exception as error:  # YAML's own errors, and those of the dates and numbers that it reads
        raise DeuxError(f"{path} is damaged or no YAML of plain values: {said(error)}.") from error
    if problem:
        raise DeuxError(f"{path} has {problem}, which is no file of deux or Hydra.")
    return value


def _problem(content: bytes) -> str | None:
    """What a file has that is not read, found before any value is made of it."""
    depth = 0
    for event in yaml.parse(content, _LOADER):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            return "YAML anchors"
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            return f"more than {DEEPEST} levels of YAML"
    return None
