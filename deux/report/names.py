"""How a report calls and orders the explorers and depth models."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

Key = tuple[str, str]
"""An explorer or a depth model: its registered name, and what tells it from others of that name ("" if alone)."""


@dataclass(frozen=True)
class Names:
    """The names and the order of a report's rows and columns.

    Args:
        models: what each depth model is called, in order of the columns.
        explorers: what each explorer is called, in order of the rows, in parts with a line between them.
    """

    models: Mapping[str, str]
    explorers: Sequence[Mapping[str, str]]

    def model(self, key: Key) -> str:
        """What a depth model is called."""
        return _called(key, self.models)

    def explorer(self, key: Key) -> str:
        """What an explorer is called."""
        return _called(key, {name: called for part in self.explorers for name, called in part.items()})

    def ordered_models(self, keys: Iterable[Key]) -> list[Key]:
        """Depth models in order; those without a name of their own come last."""
        return _ordered(keys, list(self.models))

    def explorer_parts(self, keys: Iterable[Key]) -> list[list[Key]]:
        """Explorers in order and in parts; those without a name of their own come last, in a part of theirs."""
        keys = set(keys)
        parts = [_ordered((key for key in keys if key[0] in part), list(part)) for part in self.explorers]
        named = {name for part in self.explorers for name in part}
        parts.append(sorted(key for key in keys if key[0] not in named))
        return [part for part in parts if part]

    def ordered_explorers(self, keys: Iterable[Key]) -> list[Key]:
        """Explorers in order, without the parts."""
        return [key for part in self.explorer_parts(keys) for key in part]


def _called(key: Key, names: Mapping[str, str]) -> str:
    name, variant = key
    called = str(names.get(name, name))
    return f"{called} ({variant})" if variant else called


def _ordered(keys: Iterable[Key], names: list[str]) -> list[Key]:
    return sorted(keys, key=lambda key: (names.index(key[0]) if key[0] in names else len(names), key))
