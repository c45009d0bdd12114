"""The contents of a report: tables, missing runs, and the commands of the runs."""

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
    """A section of the report: the table of one group of comparable runs.

    Args:
        title: number and caption of the table.
        dataset: display name of the test dataset.
        runs: the runs.
        table: their table.
        missing: missing runs, a line for each explorer and model.
        commands: commands of the runs.
    """

    title: str
    dataset: str
    runs: ComparableRuns
    table: ResultTable
    missing: tuple[str, ...]
    commands: tuple[str, ...]

    @property
    def state(self) -> str:
        """Number of finished and missing runs, as text."""
        finished, missing = len(self.runs.finished), len(self.runs.missing)
        return f"{counted(finished, 'run')}{f', {missing} missing' if missing else ''}"


@dataclass(frozen=True)
class Contents:
    """The contents of a report.

    Args:
        folder: folder of the runs.
        sections: sections with a table each, in the paper's order.
        notes: further remarks on the runs, a sentence each.
        finished: number of finished runs in the tables.
        missing: number of missing runs.
        corrected: tables of the errors of the models' depth corrected by the sparse points, one for each section whose
            runs have them.
        scorecards: tables of the scorecards, one for each section that has any, and of their rank correlations with
            MAE, if there are enough runs.
    """

    folder: Path
    sections: tuple[Section, ...]
    notes: tuple[str, ...]
    finished: int
    missing: int
    corrected: tuple[ResultTable, ...] = ()
    scorecards: tuple[ResultTable, ...] = ()

    @property
    def state(self) -> str:
        """Number of finished and missing runs, as text."""
        return f"{counted(self.finished, 'finished run')}, {self.missing} missing"

    @property
    def tables(self) -> tuple[ResultTable, ...]:
        """All tables of the report."""
        return (*(section.table for section in self.sections), *self.corrected, *self.scorecards)


def read_contents(
    folder: Path,
    names: DisplayNames,
    first: str | None = None,
    starred: Sequence[str] = (),
    baseline: str | tuple[str, ...] | None = None,
    presets: Mapping[str, FlatOptions] | None = None,
) -> Contents:
    """Read the runs below a folder and make the paper's tables from them.

    Args:
        folder: folder with runs and sweeps below it.
        names: display names of explorers and models, in order.
        first: display name of Table I's dataset; None for the one on which the most explorers were compared.
        starred: explorers whose models, trained on the first dataset, are also shown in Table II.
        baseline: explorers that the others are compared with, seed by seed.
        presets: named sets of explorer options; the tables show their names instead of the options.

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
        count = sum(sweep.folder in path.parents for path in ended)
        if not count:
            notes.append(f"None of {counted(sweep.runs, 'run')} is finished: {sweep.command}")
        elif count < sweep.runs != len(sweep.grid):  # missing runs of a grid are listed below its table
            notes.append(f"{count} of {counted(sweep.runs, 'run')} {plural('is', count)} finished: {sweep.command}")
    finished, missing = sum(len(group.finished) for group in groups), sum(len(group.missing) for group in groups)
    corrected, scorecards = _corrected(sections, names, baseline), _scorecards(sections, names)
    return Contents(folder, sections, tuple(notes), finished, missing, corrected, scorecards)


def missing_text(missing: Iterable[MissingRun], names: DisplayNames) -> tuple[str, ...]:
    """Missing runs as text, a line for each explorer and model: "DEUX, KBNet: seeds 1, 2 (started: 2)"."""
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
    started = ", ".join(str(run.seed) for run in runs if run.started)
    seeds = f"{plural('seed', len(runs))} {', '.join(str(run.seed) for run in runs)}"
    return f"{seeds} (started: {started})" if started else seeds


class _Tables:
    """Makes the table of each group of runs, numbered as in the paper.

    Args:
        groups: all groups, in the order of the report.
        names: display names of rows and columns.
        datasets: display names of the datasets.
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
        self._counts: Counter[str] = Counter()

    def make(self, runs: ComparableRuns) -> ResultTable:
        """The table of a group: I for the first dataset, II for another, III for models trained on another dataset."""
        datasets, names = self._datasets, self._names
        tested_on = datasets.name(runs.testing)
        kind = "table3" if runs.transferred else "table1" if runs.testing == datasets.first else "table2"
        self._counts[kind] += 1
        name = kind if self._counts[kind] == 1 else f"{kind}_{self._counts[kind]}"
        if kind == "table1":
            return table_one(runs, names, tested_on, name, self._baseline)
        if kind == "table3":
            return table_three(runs, names, datasets.name(runs.own_testing), tested_on, name)
        transfer = (datasets.first, runs.testing, runs.budget)
        from_first = [g for g in self._groups if g.transferred and (g.own_testing, g.testing, g.budget) == transfer]
        return table_two(runs, from_first, names, (datasets.name(datasets.first), tested_on), self._starred, name)


def _section(
    table: ResultTable,
    runs: ComparableRuns,
    groups: Sequence[ComparableRuns],
    names: DisplayNames,
    datasets: DatasetNames,
) -> Section:
    """The section of a group of runs; its title includes what differs from an earlier group with the same datasets."""
    first = next(g for g in groups if (g.own_testing, g.testing) == (runs.own_testing, runs.testing))
    if runs is not first:
        table = replace(table, caption=f"{table.caption}, with {differences(runs.training, first.training)}")
    title = f"Table {_NUMERALS[table.name.partition('_')[0]]}: {table.caption}"
    missing = missing_text(runs.missing, names)
    return Section(title, datasets.name(runs.testing), runs, table, missing, _commands(runs))


def _corrected(
    sections: Sequence[Section], names: DisplayNames, baseline: str | tuple[str, ...] | None
) -> tuple[ResultTable, ...]:
    """The tables of corrected depth of the sections that have any: a row for each explorer, as in Table I.

    Results have no errors of corrected depth by scene, so that there are no intervals over scenes.
    """
    tables = []
    for section in sections:
        finished = tuple(
            replace(run, results=replace(run.results, metrics=run.results.corrected, scenes=[]))
            for run in section.runs.finished
            if run.results and run.results.corrected
        )
        if finished:
            runs = replace(section.runs, finished=finished, unfinished=())
            table = table_one(runs, names, section.dataset, f"{section.table.name}_corrected", baseline)
            tables.append(replace(table, caption=f"Depth corrected by the sparse points, {section.title}"))
    return tuple(tables)


def _scorecards(sections: Sequence[Section], names: DisplayNames) -> tuple[ResultTable, ...]:
    """The scorecard tables of the sections that have any, and the table of their rank correlations with MAE."""
    with_scorecards = [section for section in sections if any(run.scorecard for run in section.runs.finished)]
    tables: list[ResultTable | None] = []
    for number, section in enumerate(with_scorecards, start=1):
        caption = "Scorecards of the training frames"
        if len(with_scorecards) > 1:
            caption += f" of {section.title}"
        name = "scorecards" if number == 1 else f"scorecards_{number}"
        tables.append(scorecard_table(section.runs, names, caption, name))
    tables.append(correlation_table([section.runs for section in with_scorecards], names))
    return tuple(table for table in tables if table is not None)


def _commands(runs: ComparableRuns) -> tuple[str, ...]:
    """The commands of the sweeps, and of runs that belong to no sweep."""
    swept = {sweep.folder for sweep in runs.sweeps}
    single = [run for run in runs.runs if run.path.parent not in swept]
    commands = {shlex.join(["python", "-m", "deux", *run.overrides]) for run in single}
    return (*(sweep.command for sweep in runs.sweeps), *sorted(commands))
