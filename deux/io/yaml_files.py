"""YAML files from outside, as plain values: nothing in them is executed or resolved."""

from pathlib import Path
from typing import Any

import yaml

from deux.errors import DeuxError
from deux.io.arrays import said
from deux.io.atomic import read_bytes

MOST_VALUES = 100_000
"""Values that a file may hold, each counted as often as aliases repeat it; a composed configuration has hundreds."""


def read_yaml(path: Path) -> Any:
    """Read a YAML file of plain values: mappings, lists, text, numbers, true and false, null and dates.

    A few hundred bytes of aliases can stand for more values than there is memory for; they are counted first.

    Raises:
        DeuxError: the file is missing, is no such YAML, or holds more than `MOST_VALUES`.
    """
    content = read_bytes(path)
    try:
        value = yaml.safe_load(content)
        count = _count(value, {})
    except RecursionError as error:
        raise DeuxError(f"{path} is damaged: its YAML is nested too deep.") from error
    except Exception as error:  # YAML's own errors, and those of the dates and numbers that it reads
        raise DeuxError(f"{path} is damaged or no YAML of plain values: {said(error)}.") from error
    if count > MOST_VALUES:
        raise DeuxError(f"{path} holds more than {MOST_VALUES:,} values, which is no file of deux or Hydra.")
    return value


def _count(value: Any, known: dict[int, float]) -> float:
    """The number of values in a value; infinite in one that holds itself."""
    if not isinstance(value, dict | list | set):
        return 1
    if id(value) not in known:
        known[id(value)] = float("inf")
        items = [*value, *value.values()] if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_count(item, known) for item in items)
    return known[id(value)]
