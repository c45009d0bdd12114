"""Commands that are printed for the user to copy: options as Hydra reads them, quoted for the shell."""

import json
import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

_PLAIN = re.compile(r"[\w./:+@%~-]*[A-Za-z/][\w./:+@%~-]*")
"""Strings that Hydra reads without quotes; those without a letter or slash might be numbers."""

_WORDS = ("null", "true", "false", "inf", "nan", "yes", "no", "on", "off")


def command_line(options: Mapping[str, Any], overrides: Iterable[str] = ()) -> str:
    """A `python -m deux` command line, quoted for the shell.

    Args:
        options: values by key, in the order of the command line.
        overrides: overrides of another command, verbatim; they come first.

    Example:
        >>> command_line({"task": "evaluate", "data.gap": 2, "data.test": ["a b", None], "evaluation.data": "old room"})
        'python -m deux task=evaluate data.gap=2 \\'data.test=["a b",null]\\' \\'evaluation.data="old room"\\''
    """
    values = (f"{key}={_hydra_value(value)}" for key, value in options.items())
    return shlex.join(["python", "-m", "deux", *overrides, *values])


def overrides_of(overrides: Iterable[str], names: Collection[str]) -> list[str]:
    """Select the overrides whose option or section is in `names`.

    Example:
        >>> overrides_of(["task=train", "+camera.width=64", "seed=1", "seed_model.steps=9"], ("camera", "seed"))
        ['+camera.width=64', 'seed=1']
    """
    keys = {override: override.lstrip("+~").partition("=")[0] for override in overrides}
    return [override for override, key in keys.items() if key in names or key.partition(".")[0] in names]


def _hydra_value(value: Any) -> str:
    if isinstance(value, Path):
        value = str(value)
    if isinstance(value, str):
        plain = _PLAIN.fullmatch(value) and value.lower() not in _WORDS and not re.fullmatch(r"[\d.+-]+e[\d+-]+", value)
        return value if plain else '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{key}:{_hydra_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, Sequence):
        return "[" + ",".join(map(_hydra_value, value)) + "]"
    return json.dumps(value)
