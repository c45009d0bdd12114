"""A table of the paper's form, and which of its numbers are best and second best."""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Literal

from deux.report.summary import Summary

METRICS = ("MAE", "RMSE", "iMAE", "iRMSE")
UNITS = ("mm", "mm", "1/km", "1/km")

Mark = Literal["best", "second"]


@dataclass(frozen=True)
class Row:
    """One row.

    Args:
        labels: its first cells.
        numbers: four errors for each group of columns; None where there is no run.
        ranked: whether it takes part in the ranking.
    """

    labels: tuple[str, ...]
    numbers: tuple[Summary | None, ...]
    ranked: bool = True


@dataclass(frozen=True)
class Table:
    """One table.

    Args:
        name: of its files, such as "table1".
        caption: what it shows.
        label_columns: what the labels of a row are.
        groups: what stands above each four columns of errors; (""), if there are four columns only.
        parts: the rows, in parts with a line between them.
        ranked_by_part: whether the best is looked for in each part, not in the whole column.
        notes: what a reader has to know, a sentence each.
    """

    name: str
    caption: str
    label_columns: tuple[str, ...]
    groups: tuple[str, ...]
    parts: tuple[tuple[Row, ...], ...]
    ranked_by_part: bool = False
    notes: tuple[str, ...] = ()

    @property
    def columns(self) -> int:
        """Number of columns with errors."""
        return len(METRICS) * len(self.groups)

    @property
    def marks(self) -> dict[tuple[int, int, int], Mark]:
        """Best and second best numbers by part, row and column; equal numbers share a rank."""
        found: dict[tuple[int, int, int], Mark] = {}
        everything = list(range(len(self.parts)))
        for parts in [[part] for part in everything] if self.ranked_by_part else [everything]:
            for column in range(self.columns):
                found |= self._ranks(parts, column)
        return found

    @property
    def usual_seeds(self) -> tuple[int, ...]:
        """The seeds that most numbers are over; a number over others has to say so."""
        seeds = Counter(n.seeds for part in self.parts for row in part for n in row.numbers if n and n.seeds)
        return max(seeds, key=lambda s: (seeds[s], len(s))) if seeds else ()

    def _ranks(self, parts: list[int], column: int) -> dict[tuple[int, int, int], Mark]:
        values = {}
        for part in parts:
            for index, row in enumerate(self.parts[part]):
                number = row.numbers[column]
                if row.ranked and number is not None and not math.isnan(number.mean):
                    values[part, index, column] = number.mean
        ranks: tuple[Mark, ...] = ("best", "second")
        order = dict(zip(sorted(set(values.values())), ranks, strict=False))
        return {place: order[value] for place, value in values.items() if value in order} if len(values) > 1 else {}


def number_text(number: Summary | None, usual_seeds: tuple[int, ...], plus_minus: str = " ± ") -> tuple[str, str]:
    """A number as text: the mean, and what stands behind it, the interval and a number of seeds unlike the others'.

    Example:
        >>> number_text(Summary(12.345, 0.5, (0, 1)), (0, 1, 2))
        ('12.3', ' ± 0.5 (n=2)')
    """
    if number is None:
        return "–", ""
    interval = "" if number.interval is None else f"{plus_minus}{number.interval:.1f}"
    seeds = f" (n={len(number.seeds)})" if number.seeds and len(number.seeds) != len(usual_seeds) else ""
    return f"{number.mean:.1f}", interval + seeds
