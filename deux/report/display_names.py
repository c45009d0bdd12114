"""Display names and order of explorers and depth models in a report."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from deux.collection.specification import VIEWPOINTS


class Variant(NamedTuple):
    """An explorer or a depth model with particular options.

    Args:
        name: its registered name.
        label: the options that distinguish it from other variants of this name; empty if there are none.
    """

    name: str
    label: str = ""

    @property
    def is_ceiling(self) -> bool:
        """Whether it stands for free viewpoints, an upper bound that is not ranked."""
        return self.name == VIEWPOINTS


@dataclass(frozen=True)
class DisplayNames:
    """Display names and order of a report's rows and columns.

    Args:
        models: display names of the depth models, in the order of the columns.
        explorers: display names of the explorers, in the order of the rows, in groups separated by a line.
    """

    models: Mapping[str, str]
    explorers: Sequence[Mapping[str, str]]

    def model(self, variant: Variant) -> str:
        """The display name of a depth model."""
        return _display_name(variant, self.models)

    def explorer(self, variant: Variant) -> str:
        """The display name of an explorer."""
        return _display_name(variant, {name: text for part in self.explorers for name, text in part.items()})

    def ordered_models(self, variants: Iterable[Variant]) -> list[Variant]:
        """Depth models in order; those without a display name come last."""
        return _ordered(variants, list(self.models))

    def explorer_parts(self, variants: Iterable[Variant]) -> list[list[Variant]]:
        """Explorers in order, in groups; those without a display name come last, but before the ceiling."""
        variants = set(variants)
        ceiling = sorted(variant for variant in variants if variant.is_ceiling)
        variants -= set(ceiling)
        parts = [_ordered((v for v in variants if v.name in part), list(part)) for part in self.explorers]
        named = {name for part in self.explorers for name in part}
        parts.append(sorted(variant for variant in variants if variant.name not in named))
        return [part for part in (*parts, ceiling) if part]

    def ordered_explorers(self, variants: Iterable[Variant]) -> list[Variant]:
        """Explorers in order, without groups."""
        return [variant for part in self.explorer_parts(variants) for variant in part]


def _display_name(variant: Variant, names: Mapping[str, str]) -> str:
    name = str(names.get(variant.name, variant.name))
    return f"{name} ({variant.label})" if variant.label else name


def _ordered(variants: Iterable[Variant], names: list[str]) -> list[Variant]:
    return sorted(variants, key=lambda v: (names.index(v.name) if v.name in names else len(names), v))
