"""Commands that are printed for the user to copy: options as Hydra reads them, quoted for the shell."""

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_PLAIN = re.compile(r"[\w./:+@%~-]*[A-Za-z/][\w./:+@%~-]*")
"""Texts that Hydra takes as they are; those without a letter or slash might be numbers."""

_WORDS = ("null", "true", "false", "inf", "nan", "yes", "no", "on", "off")


def command_line(options: Mapping[str, Any]) -> str:
    """The command with these options, by their keys in the order in which they are given.

    Example:
        >>> command_line({"task": "evaluate", "data.gap": 2, "data.test": ["a b", None], "evaluation.data": "old room"})
        'python -m deux task=evaluate data.gap=2 \\'data.test=["a b",null]\\' \\'evaluation.data="old room"\\''
    """
    return shlex.join(["python", "-m", "deux", *(f"{key}={_written(value)}" for key, value in options.items())])


def _written(value: Any) -> str:
    if isinstance(value, Path):
        value = str(value)
    if isinstance(value, str):
        plain = _PLAIN.fullmatch(value) and value.lower() not in _WORDS and not re.fullmatch(r"[\d.+-]+e[\d+-]+", value)
        return value if plain else '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{key}:{_written(one)}" for key, one in value.items()) + "}"
    if isinstance(value, Sequence):
        return "[" + ",".join(map(_written, value)) + "]"
    return json.dumps(value)
