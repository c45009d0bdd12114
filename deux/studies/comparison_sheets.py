"""The tables of a comparison of explorers."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

from deux.metrics.intervals import Estimate
from deux.report.sheet import Cell, Sheet, estimate_cell
from deux.studies.exploration_meter import REWARD
from deux.studies.explorer_comparison import ExplorerComparison as Comparison

_MEAN = "mean ± half the 95 % t interval over the scenes"


class Column(NamedTuple):
    """How a number is shown.

    Args:
        title: its heading, with the unit.
        digits: after the decimal point.
        factor: what the number is multiplied by.
        best: whether the highest or the lowest mean stands out.
    """

    title: str
    digits: int = 1
    factor: float = 1.0
    best: Literal["highest", "lowest"] | None = "highest"


COLUMNS = {
    "area_seen": Column("area seen [m²]"),
    "floor_covered": Column("free floor covered [%]", factor=100.0),
    "objects_seen": Column("objects seen"),
    "collisions": Column("collisions", best="lowest"),
    "path_length": Column("path length [m]", best=None),
}
"""The columns, by the names of their numbers in `Exploration`."""


def measures_sheet(comparison: Comparison) -> Sheet:
    """What each explorer saw, the best of each column in bold."""
    columns = []
    for name, column in COLUMNS.items():
        found = [comparison.estimate(explorer, name) for explorer in comparison.explorers]
        best = _best([value.mean for value in found], column)
        columns.append([_cell(value, column, value.mean == best) for value in found])
    titles = [column.title for column in COLUMNS.values()]
    return _sheet(f"What the explorers saw, {_MEAN}", comparison.explorers, titles, columns)


def rewards_sheet(comparison: Comparison) -> Sheet:
    """The sum of each reward over an episode, the one that an explorer was trained for in bold."""
    columns = [
        [
            _cell(comparison.estimate(explorer, REWARD + reward), Column(reward, 2), own == reward)
            for explorer in comparison.explorers
            for own in [comparison.own_rewards.get(explorer)]
        ]
        for reward in comparison.rewards
    ]
    return _sheet(f"The rewards of an episode, own in bold, {_MEAN}", comparison.explorers, comparison.rewards, columns)


def gains_sheet(comparison: Comparison, baseline: str) -> Sheet:
    """How far each explorer is ahead of one of them, by columns and by the own reward; bold: surely ahead."""
    others = tuple(explorer for explorer in comparison.explorers if explorer != baseline)
    shown = {name: column for name, column in COLUMNS.items() if column.best == "highest"}
    columns = [[_gain(comparison, e, baseline, name, column) for e in others] for name, column in shown.items()]
    own = [REWARD + comparison.own_rewards[e] if e in comparison.own_rewards else "" for e in others]
    columns.append([_gain(comparison, e, baseline, own[i], Column("", 2)) for i, e in enumerate(others)])
    title = f"More than {baseline} in the same scene, {_MEAN}, bold where the interval is above 0"
    return _sheet(title, others, [*(column.title for column in shown.values()), "own reward"], columns)


def _gain(comparison: Comparison, explorer: str, baseline: str, name: str, column: Column) -> Cell:
    value = comparison.gain(explorer, baseline, name)
    return _cell(value, column, value.mean > value.half_width)


def _sheet(title: str, explorers: tuple[str, ...], titles: Sequence[str], columns: list[list[Cell]]) -> Sheet:
    rows = tuple((Cell(explorer), *cells) for explorer, *cells in zip(explorers, *columns, strict=True))
    return Sheet(title, ("explorer", *titles), rows)


def _best(means: list[float], column: Column) -> float:
    known = [mean for mean in means if math.isfinite(mean)]
    if not known or column.best is None:
        return math.nan
    return max(known) if column.best == "highest" else min(known)


def _cell(value: Estimate, column: Column, bold: bool) -> Cell:
    return estimate_cell(value, column.digits, column.factor, bold)
