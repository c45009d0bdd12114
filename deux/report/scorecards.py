"""The scorecards of a report's runs as a table, and which of their entries go with the errors of the models."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from deux.errors import plural
from deux.metrics.intervals import Estimate
from deux.metrics.tables import Cell, Column, ResultTable, Row
from deux.report.comparable_runs import ComparableRuns
from deux.report.display_names import DisplayNames, Variant
from deux.report.runs import Run

ENTRIES = {
    "parallax": Column("parallax", "%", factor=100.0),
    "moved": Column("moved", "%", factor=100.0),
    "places": Column("places", digits=0),
    "views": Column("views", digits=0),
    "near": Column("near", "%", factor=100.0),
    "middle": Column("middle", "%", factor=100.0),
    "far": Column("far", "%", factor=100.0),
    "depth_distance": Column("depth distance", digits=3),
    "actions": Column("actions", digits=0),
    "bumps": Column("bumps per 100 actions"),
    "area": Column("area seen", "m²"),
    "floor_share": Column("free floor seen", "%", factor=100.0),
    "area_per_action": Column("area per action", "m²", digits=3),
}
"""The columns, by the names of the entries of `deux.metrics.scorecard.Scorecard` that they show."""

LEAST_RUNS = 6
"""Runs that a rank correlation takes at least."""

_ROUNDING = 1e-9
"""Values that differ from their median by less are equal."""


def scorecard_table(runs: ComparableRuns, names: DisplayNames, caption: str, name: str) -> ResultTable | None:
    """The scorecards of comparable runs, a row for each explorer: the mean over its runs, of whatever depth model.

    Args:
        runs: those without a scorecard do not count, and explorers without any have no row.
        names: of the rows.
        caption: of the table.
        name: of the table's files.

    Returns:
        None where no run has a scorecard.
    """
    found: dict[Variant, dict[str, list[Run]]] = defaultdict(lambda: defaultdict(list))
    for (explorer, _), cell in runs.cells.items():
        for run in cell.values():
            if run.scorecard is not None:
                found[explorer][run.scorecard.sources].append(run)
    choices = sorted({sources for members in found.values() for sources in members})
    parts = []
    for part in names.explorer_parts(found):
        rows = []
        for explorer in part:
            for sources, members in sorted(found[explorer].items()):
                told = f" (sources: {sources})" if len(choices) > 1 else ""
                cells = tuple(_cell(members, entry) for entry in ENTRIES)
                rows.append(Row((names.explorer(explorer) + told,), cells, ranked=False))
        parts.append(tuple(rows))
    if not parts:
        return None
    table = ResultTable(caption, ("Exploration",), tuple(ENTRIES.values()), tuple(parts), name=name)
    seeds = table.usual_seeds
    notes = (
        f"Mean over the runs of each explorer, of {plural('seed', len(seeds))} {', '.join(map(str, seeds))} where a "
        "number says no others.",
        f"Judged with the source frames that the models were trained with (sources: {', '.join(choices)}).",
    )
    return replace(table, notes=notes)


def correlation_table(groups: Sequence[ComparableRuns], names: DisplayNames) -> ResultTable | None:
    """Spearman's rank correlation of each entry with MAE, one depth model at a time, over all runs of a report.

    From both, the median over the runs with the same model, seed and budget is taken off first: what a seed does to all
    explorers alike does not count, and one failed training does not move the others. The ceiling's runs are left out,
    and those of models that were tested on another dataset.

    Args:
        groups: all groups of comparable runs.
        names: of the models.

    Returns:
        None where no model has `LEAST_RUNS` runs that share their seed and budget with another explorer's.
    """
    own = [group for group in groups if not group.transferred]
    models = names.ordered_models({model for group in own for model in group.models})
    found = {model: [_correlation(_pairs(own, model, entry)) for entry in ENTRIES] for model in models}
    shown = [model for model in models if any(cells[0].estimate for cells in found[model])]
    if not shown:
        return None
    rows = []
    for number, column in enumerate(ENTRIES.values()):
        cells = tuple(cell for model in shown for cell in found[model][number])
        if any(cell.estimate for cell in cells):
            rows.append(Row((column.title,), cells, ranked=False))
    notes = [
        "Spearman's rank correlation ρ of each entry with MAE, after the median over the runs with the same model, "
        "seed and budget was taken off both.",
        "Below 0: runs that have more of the entry than the others with their seed tend to have a smaller MAE.",
    ]
    if any(explorer.is_ceiling for group in own for explorer in group.explorers):
        notes.append("The runs of free viewpoints, the ceiling, are left out.")
    return ResultTable(
        "Rank correlation of the scorecards' entries with MAE",
        ("Entry",),
        (Column("ρ", digits=2), Column("runs", digits=0)),
        (tuple(rows),),
        groups=tuple(names.model(model) for model in shown),
        name="scorecard_correlations",
        notes=tuple(notes),
    )


def _cell(runs: Sequence[Run], entry: str) -> Cell:
    """The mean of an entry over the runs that have it."""
    having = [(run.conditions.seed, value) for run in runs if (value := _value(run, entry)) is not None]
    if not having:
        return Cell()
    mean = sum(value for _, value in having) / len(having)
    return Cell(Estimate(mean, math.nan), seeds=tuple(sorted({seed for seed, _ in having})))


def _value(run: Run, entry: str) -> float | None:
    return None if run.scorecard is None else run.scorecard.entries()[entry]


def _pairs(groups: Sequence[ComparableRuns], model: Variant, entry: str) -> np.ndarray:
    """An entry and the MAE of the runs that have it, N x 2, each less its median over the runs of a group and a seed.

    Scorecards that judge other source frames are not compared with one another.
    """
    found = [np.zeros((0, 2))]
    for group in groups:
        alike: dict[tuple[int, str], list[tuple[float, float]]] = defaultdict(list)
        for (explorer, other), cell in group.cells.items():
            for seed, run in cell.items() if other == model and not explorer.is_ceiling else ():
                if run.scorecard is not None and (value := run.scorecard.entries()[entry]) is not None:
                    alike[seed, run.scorecard.sources].append((value, run.errors["mae"]))
        # One explorer alone differs from nothing.
        found += [values - np.median(values, axis=0) for values in map(np.array, alike.values()) if len(values) > 1]
    return np.concatenate(found)


def _correlation(pairs: np.ndarray) -> tuple[Cell, Cell]:
    """The rank correlation of N x 2 values and N; empty cells with too few of them, or where one side is constant."""
    if len(pairs) < LEAST_RUNS:
        return Cell(), Cell()
    scale = np.abs(pairs).max(axis=0)
    if (scale < _ROUNDING).any():
        return Cell(), Cell()
    # Equal runs differ from their median by rounding alone, which must not rank them.
    correlation = stats.spearmanr(*np.round(pairs / scale, 9).T).statistic
    return Cell(Estimate(float(correlation))), Cell(Estimate(float(len(pairs))))
