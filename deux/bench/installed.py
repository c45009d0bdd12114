"""The plugins that can be measured."""

from typing import Any

from deux.errors import DeuxError
from deux.registry import registry


def installed(kind: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """One of each installed plugin of a kind, with its default options, by name; and a note on each broken one."""
    made, notes = {}, []
    for name in registry().names(kind):
        try:
            made[name] = registry().create(kind, name, {})
        except DeuxError as error:
            notes.append(f"{name} is left out: {error}")
    return made, tuple(notes)
