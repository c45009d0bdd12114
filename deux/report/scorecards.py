"""Tables of the scorecards of a report's runs, and of their rank correlation with the models' errors."""

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
"""The columns, by the names of the entries of `deux.metrics.scorecard.Scorecard`."""

LEAST_RUNS = 6
"""Minimal number of runs for a rank correlation."""

_ROUNDING = 1e-9
"""Differences from the median below this are rounding errors."""


def scorecard_table(runs: ComparableRuns, names: DisplayNames, caption: str, name: str) -> ResultTable | None:
    """The scorecards of comparable runs, a row for each explorer: the mean over its runs with all depth models.

    Args:
        runs: the runs; those without a scorecard are left out.
        names: display names of the rows.
        caption: caption of the table.
        name: name of the table's files.

    Returns:
        None if no run has a scorecard.
    """
    members: dict[Variant, dict[str, list[Run]]] = defaultdict(lambda: defaultdict(list))
    for (explorer, _), cell in runs.cells.items():
        for run in cell.values():
            if run.scorecard is not None:
                members[explorer][run.scorecard.sources].append(run)
    choices = sorted({sources for by_sources in members.values() for sources in by_sources})
    parts = []
    for part in names.explorer_parts(members):
        rows = []
        for explorer in part:
            for sources, explorer_runs in sorted(members[explorer].items()):
                suffix = f" (sources: {sources})" if len(choices) > 1 else ""
                cells = tuple(_cell(explorer_runs, entry) for entry in ENTRIES)
                rows.append(Row((names.explorer(explorer) + suffix,), cells, ranked=False))
        parts.append(tuple(rows))
    if not parts:
        return None
    table = ResultTable(caption, ("Exploration",), tuple(ENTRIES.values()), tuple(parts), name=name)
    seeds = table.usual_seeds
    notes = (
        f"Mean over the runs of each explorer, of {plural('seed', len(seeds))} {', '.join(map(str, seeds))} unless a "
        "number lists other seeds.",
        f"Computed with the source frames that the models were trained with (sources: {', '.join(choices)}).",
    )
    return replace(table, notes=notes)


def correlation_table(groups: Sequence[ComparableRuns], names: DisplayNames) -> ResultTable | None:
    """Spearman's rank correlation of each entry with MAE, one depth model at a time, over all runs of a report.

    The median over the runs with the same model, seed and budget is subtracted from both first. This removes effects of
    the seed on all explorers, and is robust against a failed training. Runs of free viewpoints and of models that were
    tested on another dataset are left out.

    Args:
        groups: all groups of comparable runs.
        names: display names of the models.

    Returns:
        None if no model has `LEAST_RUNS` runs that share seed and budget with another explorer's run.
    """
    own = [group for group in groups if not group.transferred]
    models = names.ordered_models({model for group in own for model in group.models})
    correlations = {model: [_correlation(_pairs(own, model, entry)) for entry in ENTRIES] for model in models}
    shown = [model for model in models if any(cells[0].estimate for cells in correlations[model])]
    if not shown:
        return None
    rows = []
    for number, column in enumerate(ENTRIES.values()):
        cells = tuple(cell for model in shown for cell in correlations[model][number])
        if any(cell.estimate for cell in cells):
            rows.append(Row((column.title,), cells, ranked=False))
    notes = [
        "Spearman's rank correlation ρ of each entry with MAE, after subtracting the median over the runs with the "
        "same model, seed and budget from both.",
        "Below 0: runs with a larger value than others with the same seed tend to have a smaller MAE.",
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
    values = [(run.conditions.seed, value) for run in runs if (value := _value(run, entry)) is not None]
    if not values:
        return Cell()
    mean = sum(value for _, value in values) / len(values)
    return Cell(Estimate(mean, math.nan), seeds=tuple(sorted({seed for seed, _ in values})))


def _value(run: Run, entry: str) -> float | None:
    return None if run.scorecard is None else run.scorecard.entries()[entry]


def _pairs(groups: Sequence[ComparableRuns], model: Variant, entry: str) -> np.ndarray:
    """Pairs of an entry and the MAE, N x 2, each minus the median over the runs with the same group and seed.

    Scorecards that were computed with different choices of source frames are not compared.
    """
    pairs = [np.zeros((0, 2))]
    for group in groups:
        comparable: dict[tuple[int, str], list[tuple[float, float]]] = defaultdict(list)
        for (explorer, other), cell in group.cells.items():
            for seed, run in cell.items() if other == model and not explorer.is_ceiling else ():
                if run.scorecard is not None and (value := run.scorecard.entries()[entry]) is not None:
                    comparable[seed, run.scorecard.sources].append((value, run.errors["mae"]))
        arrays = map(np.array, comparable.values())
        pairs += [values - np.median(values, axis=0) for values in arrays if len(values) > 1]
    return np.concatenate(pairs)


def _correlation(pairs: np.ndarray) -> tuple[Cell, Cell]:
    """The rank correlation of pairs, N x 2, and N; empty cells with too few pairs, or if one variable is constant."""
    if len(pairs) < LEAST_RUNS:
        return Cell(), Cell()
    scale = np.abs(pairs).max(axis=0)
    if (scale < _ROUNDING).any():
        return Cell(), Cell()
    # Rounding errors must not affect the ranks of equal runs.
    correlation = stats.spearmanr(*np.round(pairs / scale, 9).T).statistic
    return Cell(Estimate(float(correlation))), Cell(Estimate(float(len(pairs))))
