"""Safe reading of YAML files as plain values: nothing in them is executed or resolved."""

from pathlib import Path
from typing import Any

import yaml

from deux.errors import DeuxError, error_text
from deux.io.atomic import read_bytes

MOST_BYTES = 2**20
"""Greatest size of a file; a composed configuration has a few thousand bytes."""

DEEPEST = 40
"""Greatest nesting depth of lists and mappings."""

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(path: Path) -> Any:
    """Read a YAML file of plain values: mappings, lists, strings, numbers, booleans, null and dates.

    Interpolations such as `${oc.env:HOME}` are not resolved. Anchors, with which a small file can expand to more values
    than fit into memory, are refused; neither deux nor Hydra writes them.

    Raises:
        DeuxError: the file is missing, is not such YAML, has anchors, is nested more deeply than `DEEPEST` or larger
            than `MOST_BYTES`.
    """
    content = read_bytes(path)
    if len(content) > MOST_BYTES:
        raise DeuxError(f"{path} has more than {MOST_BYTES:,} bytes: it is not a file of deux or Hydra.")
    try:
        problem = _problem(content)
        value = None if problem else yaml.load(content, _LOADER)
    except Exception as error:  # errors of YAML, and of parsing dates and numbers
        raise DeuxError(f"{path} is damaged or not YAML of plain values: {error_text(error)}.") from error
    if problem:
        raise DeuxError(f"{path} has {problem}: it is not a file of deux or Hydra.")
    return value


def _problem(content: bytes) -> str | None:
    """What is not allowed in the file, determined before any value is created; None if it is fine."""
    depth = 0
    for event in yaml.parse(content, _LOADER):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            return "YAML anchors"
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            return f"more than {DEEPEST} levels of YAML"
    return None
