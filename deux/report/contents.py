"""All that a report says: tables, what is missing, and how the runs were made."""

import itertools
import shlex
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from deux.report.comparison import Comparison, Missing, comparisons, lone_sweeps
from deux.report.conditions import differences
from deux.report.datasets import Datasets
from deux.report.names import Key, Names
from deux.report.paper_tables import table_one, table_three, table_two
from deux.report.runs import find_runs
from deux.report.sweeps import find_sweeps
from deux.report.tables import Table


@dataclass(frozen=True)
class Section:
    """One comparison in the report.

    Args:
        title: what is compared, on which dataset.
        dataset: what the test frames' dataset is called.
        comparison: the runs.
        table: its table.
        missing: what is not finished, a sentence each.
        commands: that made the runs.
    """

    title: str
    dataset: str
    comparison: Comparison
    table: Table
    missing: tuple[str, ...]
    commands: tuple[str, ...]

    @property
    def state(self) -> str:
        """How many runs are there and how many are missing."""
        finished, missing = len(self.comparison.finished), len(self.comparison.missing)
        return f"{finished} run{'s' * (finished != 1)}{f', {missing} missing' if missing else ''}"


@dataclass(frozen=True)
class Contents:
    """The report.

    Args:
        folder: below which the runs were found.
        sections: a table each, in the paper's order.
        notes: what else has to be said of the runs, a sentence each.
        finished: number of finished runs in the tables.
        missing: number of runs that are not finished.
    """

    folder: Path
    sections: tuple[Section, ...]
    notes: tuple[str, ...]
    finished: int
    missing: int


def read_contents(
    folder: Path,
    names: Names,
    first: str | None = None,
    starred: Sequence[str] = (),
    baseline: str | None = None,
) -> Contents:
    """Read the runs below a folder and put them into the paper's tables.

    Args:
        folder: has runs and sweeps below it.
        names: of explorers and models, in order.
        first: the name of Table I's dataset; None for the one on which the most explorers were compared.
        starred: explorers of which Table II also shows the models that were trained on the first dataset.
        baseline: the explorer that the others are compared with, seed by seed.

    Raises:
        DeuxError: there is no finished run, a run's file is damaged, or no dataset is called `first`.
    """
    found, sweeps = find_runs(folder), find_sweeps(folder)
    compared = comparisons(found, sweeps)
    datasets = Datasets(compared, first)
    ordered = sorted(compared, key=lambda c: (c.transferred, c.testing != datasets.first))  # stable: largest first
    sections = []
    used: dict[str, int] = defaultdict(int)
    for comparison in ordered:
        kind = "table3" if comparison.transferred else "table1" if comparison.testing == datasets.first else "table2"
        used[kind] += 1
        name = kind if used[kind] == 1 else f"{kind}_{used[kind]}"
        table = _table(kind, name, comparison, ordered, names, datasets, starred, baseline)
        sections.append(_section(table, comparison, ordered, names, datasets))
    notes = [f"{path} is in no table: {reason}." for path, reason in found.left_out]
    notes += [f"Nothing is finished of {len(s.grid)} runs: {s.command}" for s in lone_sweeps(found, sweeps)]
    counted = sum(len(c.finished) for c in compared)
    return Contents(folder, tuple(sections), tuple(notes), counted, sum(len(c.missing) for c in compared))


def missing_text(missing: Iterable[Missing], names: Names) -> tuple[str, ...]:
    """What is missing, a line for each explorer and model: "DEUX, KBNet: seeds 1, 2 (begun: 2)"."""
    cells: dict[tuple[Key, Key], list[Missing]] = defaultdict(list)
    for run in missing:
        cells[run.explorer, run.model].append(run)
    explorers = names.ordered_explorers({explorer for explorer, _ in cells})
    models = names.ordered_models({model for _, model in cells})
    return tuple(
        f"{names.explorer(explorer)}, {names.model(model)}: {_seeds(cells[explorer, model])}"
        for explorer, model in itertools.product(explorers, models)
        if (explorer, model) in cells
    )


def _seeds(runs: Sequence[Missing]) -> str:
    begun = ", ".join(str(run.seed) for run in runs if run.begun)
    seeds = f"seed{'s' * (len(runs) > 1)} {', '.join(str(run.seed) for run in runs)}"
    return f"{seeds} (begun: {begun})" if begun else seeds


def _table(
    kind: str,
    name: str,
    comparison: Comparison,
    others: Sequence[Comparison],
    names: Names,
    datasets: Datasets,
    starred: Sequence[str],
    baseline: str | None,
) -> Table:
    tested_on = datasets.name(comparison.testing)
    if kind == "table1":
        return table_one(comparison, names, tested_on, name, baseline)
    if kind == "table3":
        return table_three(comparison, names, datasets.name(comparison.own_testing), tested_on, name)
    from_first = [
        c
        for c in others
        if c.transferred
        and (c.own_testing, c.testing, c.budget) == (datasets.first, comparison.testing, comparison.budget)
    ]
    return table_two(comparison, from_first, names, (datasets.name(datasets.first), tested_on), starred, name)


def _section(
    table: Table, comparison: Comparison, others: Sequence[Comparison], names: Names, datasets: Datasets
) -> Section:
    alike = [c for c in others if (c.own_testing, c.testing) == (comparison.own_testing, comparison.testing)]
    if comparison is not alike[0]:
        conditions = differences(comparison.training, alike[0].training)
        table = replace(table, caption=f"{table.caption}, with {conditions}")
    numeral = "I" * int(table.name.removeprefix("table")[0])
    missing = missing_text(comparison.missing, names)
    dataset = datasets.name(comparison.testing)
    return Section(f"Table {numeral}: {table.caption}", dataset, comparison, table, missing, _commands(comparison))


def _commands(comparison: Comparison) -> tuple[str, ...]:
    """The commands of the sweeps, and of those runs that belong to none."""
    swept = {sweep.folder for sweep in comparison.sweeps}
    alone = [run for run in (*comparison.finished, *comparison.begun) if run.path.parent not in swept]
    single = {shlex.join(["python", "-m", "deux", *run.overrides]) for run in alone}
    return (*(sweep.command for sweep in comparison.sweeps), *sorted(single))
