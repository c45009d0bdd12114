"""What a report says: tables, what is missing, and how the runs were made."""

import itertools
import shlex
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from deux.errors import counted, plural
from deux.metrics.tables import ResultTable
from deux.report.comparable_runs import ComparableRuns, MissingRun, group_comparable
from deux.report.conditions import FlatOptions, differences
from deux.report.dataset_names import DatasetNames
from deux.report.display_names import DisplayNames, Variant
from deux.report.paper_tables import table_one, table_three, table_two
from deux.report.runs import find_runs
from deux.report.scorecards import correlation_table, scorecard_table
from deux.report.sweeps import find_sweeps

_NUMERALS = {"table1": "I", "table2": "II", "table3": "III"}


@dataclass(frozen=True)
class Section:
    """The table of one group of comparable runs, and what belongs to it.

    Args:
        title: which table it is, and what it shows.
        dataset: what the test frames' dataset is called.
        runs: the runs.
        table: their table.
        missing: the runs that are not finished, a sentence for each explorer and model.
        commands: that made the runs.
    """

    title: str
    dataset: str
    runs: ComparableRuns
    table: ResultTable
    missing: tuple[str, ...]
    commands: tuple[str, ...]

    @property
    def state(self) -> str:
        """How many runs are there and how many are missing."""
        finished, missing = len(self.runs.finished), len(self.runs.missing)
        return f"{counted(finished, 'run')}{f', {missing} missing' if missing else ''}"


@dataclass(frozen=True)
class Contents:
    """The report.

    Args:
        folder: below which the runs were found.
        sections: a table each, in the paper's order.
        notes: what else has to be said of the runs, a sentence each.
        finished: number of finished runs in the tables.
        missing: number of runs that are not finished.
        scorecards: a table of the scorecards of each section that has any, and one of their rank correlations with MAE
            where there are enough runs.
    """

    folder: Path
    sections: tuple[Section, ...]
    notes: tuple[str, ...]
    finished: int
    missing: int
    scorecards: tuple[ResultTable, ...] = ()

    @property
    def state(self) -> str:
        """How many runs are there and how many are missing."""
        return f"{counted(self.finished, 'finished run')}, {self.missing} missing"

    @property
    def tables(self) -> tuple[ResultTable, ...]:
        """All tables."""
        return (*(section.table for section in self.sections), *self.scorecards)


def read_contents(
    folder: Path,
    names: DisplayNames,
    first: str | None = None,
    starred: Sequence[str] = (),
    baseline: str | tuple[str, ...] | None = None,
    presets: Mapping[str, FlatOptions] | None = None,
) -> Contents:
    """Read the runs below a folder and put them into the paper's tables.

    Args:
        folder: has runs and sweeps below it.
        names: of explorers and models, in order.
        first: the name of Table I's dataset; None for the one on which the most explorers were compared.
        starred: explorers of which Table II also shows the models that were trained on the first dataset.
        baseline: the explorers that the others are compared with, seed by seed.
        presets: named sets of an explorer's options, whose names stand for them in the tables.

    Raises:
        DeuxError: there is no finished run, a run's file is damaged, or no dataset is called `first`.
    """
    found, sweeps = find_runs(folder), find_sweeps(folder)
    groups = group_comparable(found, sweeps, presets)
    datasets = DatasetNames(groups, first)
    groups.sort(key=lambda group: (group.transferred, group.testing != datasets.first))  # stable: largest first
    tables = _Tables(groups, names, datasets, starred, baseline)
    sections = tuple(_section(tables.make(group), group, groups, names, datasets) for group in groups)
    notes = [f"{path} is in no table: {reason}." for path, reason in found.left_out]
    ended = [*(run.path for run in found.finished), *(path for path, _ in found.left_out)]
    for sweep in sweeps:
        there = sum(sweep.folder in path.parents for path in ended)
        if not there:
            notes.append(f"Nothing is finished of {counted(sweep.runs, 'run')}: {sweep.command}")
        elif there < sweep.runs != len(sweep.grid):  # what a grid lacks is listed below its table
            notes.append(f"{there} of {counted(sweep.runs, 'run')} {plural('is', there)} finished: {sweep.command}")
    finished, missing = sum(len(group.finished) for group in groups), sum(len(group.missing) for group in groups)
    return Contents(folder, sections, tuple(notes), finished, missing, _scorecards(sections, names))


def missing_text(missing: Iterable[MissingRun], names: DisplayNames) -> tuple[str, ...]:
    """The runs that are missing, a line for each explorer and model: "DEUX, KBNet: seeds 1, 2 (begun: 2)"."""
    cells: dict[tuple[Variant, Variant], list[MissingRun]] = defaultdict(list)
    for run in missing:
        cells[run.explorer, run.model].append(run)
    explorers = names.ordered_explorers({explorer for explorer, _ in cells})
    models = names.ordered_models({model for _, model in cells})
    return tuple(
        f"{names.explorer(explorer)}, {names.model(model)}: {_seeds(cells[explorer, model])}"
        for explorer, model in itertools.product(explorers, models)
        if (explorer, model) in cells
    )


def _seeds(runs: Sequence[MissingRun]) -> str:
    begun = ", ".join(str(run.seed) for run in runs if run.begun)
    seeds = f"{plural('seed', len(runs))} {', '.join(str(run.seed) for run in runs)}"
    return f"{seeds} (begun: {begun})" if begun else seeds


class _Tables:
    """Makes the table of each group of runs: which of the paper's it is, and its name where there are several.

    Args:
        groups: all groups, in the order of the report.
        names: of rows and columns.
        datasets: what the datasets are called.
        starred: as in `read_contents`.
        baseline: as in `read_contents`.
    """

    def __init__(
        self,
        groups: Sequence[ComparableRuns],
        names: DisplayNames,
        datasets: DatasetNames,
        starred: Sequence[str],
        baseline: str | tuple[str, ...] | None,
    ) -> None:
        self._groups, self._names, self._datasets = groups, names, datasets
        self._starred, self._baseline = starred, baseline
        self._made: Counter[str] = Counter()

    def make(self, runs: ComparableRuns) -> ResultTable:
        """The table of a group: I on the first dataset, II on another, III of models that were trained elsewhere."""
        datasets, names = self._datasets, self._names
        tested_on = datasets.name(runs.testing)
        kind = "table3" if runs.transferred else "table1" if runs.testing == datasets.first else "table2"
        self._made[kind] += 1
        name = kind if self._made[kind] == 1 else f"{kind}_{self._made[kind]}"
        if kind == "table1":
            return table_one(runs, names, tested_on, name, self._baseline)
        if kind == "table3":
            return table_three(runs, names, datasets.name(runs.own_testing), tested_on, name)
        wanted = (datasets.first, runs.testing, runs.budget)
        from_first = [g for g in self._groups if g.transferred and (g.own_testing, g.testing, g.budget) == wanted]
        return table_two(runs, from_first, names, (datasets.name(datasets.first), tested_on), self._starred, name)


def _section(
    table: ResultTable,
    runs: ComparableRuns,
    groups: Sequence[ComparableRuns],
    names: DisplayNames,
    datasets: DatasetNames,
) -> Section:
    """The section of a group of runs; where an earlier one has the same datasets, its title says what differs."""
    first = next(g for g in groups if (g.own_testing, g.testing) == (runs.own_testing, runs.testing))
    if runs is not first:
        table = replace(table, caption=f"{table.caption}, with {differences(runs.training, first.training)}")
    title = f"Table {_NUMERALS[table.name.partition('_')[0]]}: {table.caption}"
    missing = missing_text(runs.missing, names)
    return Section(title, datasets.name(runs.testing), runs, table, missing, _commands(runs))


def _scorecards(sections: Sequence[Section], names: DisplayNames) -> tuple[ResultTable, ...]:
    """The scorecards of each section that has any, and their rank correlations with MAE over all sections."""
    having = [section for section in sections if any(run.scorecard for run in section.runs.finished)]
    tables: list[ResultTable | None] = []
    for number, section in enumerate(having, start=1):
        caption = "Scorecards of the training frames"
        if len(having) > 1:
            caption += f" of {section.title}"
        name = "scorecards" if number == 1 else f"scorecards_{number}"
        tables.append(scorecard_table(section.runs, names, caption, name))
    tables.append(correlation_table([section.runs for section in having], names))
    return tuple(table for table in tables if table is not None)


def _commands(runs: ComparableRuns) -> tuple[str, ...]:
    """The commands of the sweeps, and of those runs that belong to none."""
    swept = {sweep.folder for sweep in runs.sweeps}
    alone = [run for run in runs.runs if run.path.parent not in swept]
    single = {shlex.join(["python", "-m", "deux", *run.overrides]) for run in alone}
    return (*(sweep.command for sweep in runs.sweeps), *sorted(single))
