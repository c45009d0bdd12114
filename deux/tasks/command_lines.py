"""Commands that are printed for the user to copy: options as Hydra reads them, quoted for the shell."""

import json
import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

_PLAIN = re.compile(r"[\w./:+@%~-]*[A-Za-z/][\w./:+@%~-]*")
"""Texts that Hydra takes as they are; those without a letter or slash might be numbers."""

_WORDS = ("null", "true", "false", "inf", "nan", "yes", "no", "on", "off")


def command_line(options: Mapping[str, Any], overrides: Iterable[str] = ()) -> str:
    """The command with these options, by their keys in the order in which they are given.

    Args:
        options: values by key.
        overrides: of another command, as they were written, which come first.

    Example:
        >>> command_line({"task": "evaluate", "data.gap": 2, "data.test": ["a b", None], "evaluation.data": "old room"})
        'python -m deux task=evaluate data.gap=2 \\'data.test=["a b",null]\\' \\'evaluation.data="old room"\\''
    """
    written = (f"{key}={_written(value)}" for key, value in options.items())
    return shlex.join(["python", "-m", "deux", *overrides, *written])


def overrides_of(overrides: Iterable[str], names: Collection[str]) -> list[str]:
    """Those of some overrides that are of an option, or of a section, of a name.

    Example:
        >>> overrides_of(["task=train", "+camera.width=64", "seed=1", "seed_model.steps=9"], ("camera", "seed"))
        ['+camera.width=64', 'seed=1']
    """
    keys = {override: override.lstrip("+~").partition("=")[0] for override in overrides}
    return [override for override, key in keys.items() if key in names or key.partition(".")[0] in names]


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
