"""How a report calls and orders the explorers and depth models."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from deux.collection.specification import VIEWPOINTS


class Variant(NamedTuple):
    """An explorer or a depth model as a report tells them apart.

    Args:
        name: its registered name.
        label: the options that tell it from others of that name; empty where there are no others.
    """

    name: str
    label: str = ""

    @property
    def is_ceiling(self) -> bool:
        """Whether it stands for free viewpoints, which no table ranks among the explorers."""
        return self.name == VIEWPOINTS


@dataclass(frozen=True)
class DisplayNames:
    """The names and the order of a report's rows and columns.

    Args:
        models: what each depth model is called, in order of the columns.
        explorers: what each explorer is called, in order of the rows, in parts with a line between them.
    """

    models: Mapping[str, str]
    explorers: Sequence[Mapping[str, str]]

    def model(self, variant: Variant) -> str:
        """What a depth model is called."""
        return _called(variant, self.models)

    def explorer(self, variant: Variant) -> str:
        """What an explorer is called."""
        return _called(variant, {name: called for part in self.explorers for name, called in part.items()})

    def ordered_models(self, variants: Iterable[Variant]) -> list[Variant]:
        """Depth models in order; those without a name of their own come last."""
        return _ordered(variants, list(self.models))

    def explorer_parts(self, variants: Iterable[Variant]) -> list[list[Variant]]:
        """Explorers in order and in parts: those without a name of their own after the others, and the ceiling last."""
        found = set(variants)
        ceiling = sorted(one for one in found if one.is_ceiling)
        variants = found - set(ceiling)
        parts = [_ordered((one for one in variants if one.name in part), list(part)) for part in self.explorers]
        named = {name for part in self.explorers for name in part}
        parts.append(sorted(one for one in variants if one.name not in named))
        return [part for part in (*parts, ceiling) if part]

    def ordered_explorers(self, variants: Iterable[Variant]) -> list[Variant]:
        """Explorers in order, without the parts."""
        return [one for part in self.explorer_parts(variants) for one in part]


def _called(variant: Variant, names: Mapping[str, str]) -> str:
    called = str(names.get(variant.name, variant.name))
    return f"{called} ({variant.label})" if variant.label else called


def _ordered(variants: Iterable[Variant], names: list[str]) -> list[Variant]:
    return sorted(variants, key=lambda one: (names.index(one.name) if one.name in names else len(names), one))
