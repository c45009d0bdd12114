"""Tables I, II and III of the paper, from groups of comparable runs."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product

from deux.errors import counted
from deux.metrics.depth_errors import METRICS
from deux.metrics.tables import Cell, ResultTable, Row, error_columns
from deux.report.comparable_runs import ComparableRuns, SeedErrors
from deux.report.display_names import DisplayNames, Variant

INTERPOLATION = "Interpolation"
"""What the row of linear interpolation of the sparse points is called; it learns nothing and is not ranked."""


def table_one(
    runs: ComparableRuns,
    names: DisplayNames,
    dataset: str,
    name: str = "table1",
    baseline: str | tuple[str, ...] | None = None,
) -> ResultTable:
    """Table I: every explorer and every depth model on the test split of one dataset.

    Args:
        runs: the runs.
        names: of rows and columns.
        dataset: what the dataset is called.
        name: of the table's files.
        baseline: the explorers that notes compare the others with, seed by seed; None for no such note. The way to the
            ceiling begins at the first of them.
    """
    models = names.ordered_models(runs.models)
    parts: list[tuple[Row, ...]] = [(Row((INTERPOLATION,), _cells(runs.baseline) * len(models), ranked=False),)]
    for part in names.explorer_parts(runs.explorers):
        rows = []
        for explorer in part:
            cells = [cell for model in models for cell in _cells(runs.errors(explorer, model))]
            rows.append(Row((names.explorer(explorer),), tuple(cells), ranked=not explorer.is_ceiling))
        parts.append(tuple(rows))
    table = ResultTable(
        caption=f"Depth completion on the {dataset} test set",
        label_columns=("Exploration",),
        columns=error_columns(),
        parts=tuple(parts),
        groups=tuple(names.model(model) for model in models),
        name=name,
    )
    baselines = (baseline,) if isinstance(baseline, str) else baseline or ()
    notes = [*_paired_differences(runs, names, baselines), *_shares_of_way(runs, names, baselines[:1])]
    return _finished(table, [runs], notes)


def table_two(
    runs: ComparableRuns,
    from_first: Sequence[ComparableRuns],
    names: DisplayNames,
    datasets: tuple[str, str],
    starred: Sequence[str],
    name: str = "table2",
) -> ResultTable:
    """Table II: explorers on another dataset, and beside them models that were trained on the first dataset.

    Args:
        runs: trained and tested on the other dataset.
        from_first: trained on the first dataset, tested on the same frames as `runs`.
        names: of rows.
        datasets: what the first and the other dataset are called.
        starred: explorers of which the models from the first dataset are shown; all, if none of these is there.
        name: of the table's files.
    """
    first, other = datasets
    parts: list[tuple[Row, ...]] = [(Row((INTERPOLATION, ""), _cells(runs.baseline), ranked=False),)]
    models = runs.models.union(*(group.models for group in from_first))
    for model in names.ordered_models(models):
        rows = []
        for explorer in names.ordered_explorers(runs.explorers):
            if errors := runs.errors(explorer, model):
                labels = names.model(model), names.explorer(explorer)
                rows.append(Row(labels, _cells(errors), ranked=not explorer.is_ceiling))
        for group in from_first:
            shown = [one for one in group.explorers if one.name in starred] or group.explorers
            for explorer in names.ordered_explorers(shown):
                if errors := group.errors(explorer, model):
                    labels = names.model(model), f"{names.explorer(explorer)}*"
                    rows.append(Row(labels, _cells(errors), ranked=not explorer.is_ceiling))
        parts.append(tuple(rows))
    table = ResultTable(
        caption=f"Depth completion on the {other} test set",
        label_columns=("Depth model", "Exploration"),
        columns=error_columns(),
        parts=tuple(parts),
        name=name,
    )
    notes = [f"*: trained on {first}."] if from_first else []
    return _finished(table, [runs, *from_first], notes, rank_by_part=True)


def table_three(
    runs: ComparableRuns, names: DisplayNames, trained_on: str, tested_on: str, name: str = "table3"
) -> ResultTable:
    """Table III: zero-shot transfer, every explorer averaged over the models.

    A seed counts if all models have it. Where no seed has all, the mean is over the largest set of models that a seed
    has, and over the seeds with just that set; such a row says over which models, and is not ranked.

    Args:
        runs: of models that were tested on another dataset than they were trained on.
        names: of rows and models.
        trained_on: what the dataset of the training is called.
        tested_on: what the dataset of the test is called.
        name: of the table's files.
    """
    models = names.ordered_models(runs.models)
    parts: list[tuple[Row, ...]] = [(Row((INTERPOLATION,), _cells(runs.baseline), ranked=False),)]
    for part in names.explorer_parts(runs.explorers):
        rows = []
        for explorer in part:
            averaged, errors = _over_models(runs, explorer)
            label = names.explorer(explorer)
            if len(averaged) < len(models):
                label += f" ({', '.join(names.model(model) for model in names.ordered_models(averaged))} only)"
            ranked = len(averaged) == len(models) and not explorer.is_ceiling
            rows.append(Row((label,), _cells(errors), ranked=ranked))
        parts.append(tuple(rows))
    table = ResultTable(
        caption=f"Zero-shot transfer: trained on {trained_on}, tested on {tested_on}",
        label_columns=("Exploration",),
        columns=error_columns(),
        parts=tuple(parts),
        name=name,
    )
    return _finished(
        table, [runs], [f"Every number is the mean over {', '.join(names.model(model) for model in models)}."]
    )


def _cells(errors: SeedErrors | None) -> tuple[Cell, ...]:
    """A cell for each metric, empty ones without errors."""
    if errors is None:
        return (Cell(),) * len(METRICS)
    return tuple(Cell(errors.estimates[name], seeds=errors.seeds) for name in METRICS)


def _paired_differences(runs: ComparableRuns, names: DisplayNames, baselines: Sequence[str]) -> list[str]:
    """For each model how much higher than the baselines' the explorers' errors are, a sentence each."""
    notes = []
    explorers = names.ordered_explorers(runs.explorers)
    for reference in (explorer for explorer in explorers if explorer.name in baselines):
        for model in names.ordered_models(runs.models):
            others = [other for other in explorers if other != reference]
            found = {names.explorer(other): runs.paired_difference(other, reference, model) for other in others}
            known = [f"{name} {one.mean:+.1f} ± {one.half_width:.1f}" for name, one in found.items() if one]
            if known:
                notes.append(
                    f"{names.model(model)}, MAE beyond {names.explorer(reference)}'s with the same seed (below 0 is "
                    f"better; Student's t over the seeds): {', '.join(known)}."
                )
            notes += _scene_differences(runs, names, reference, model)
    return notes


def _scene_differences(runs: ComparableRuns, names: DisplayNames, reference: Variant, model: Variant) -> Iterator[str]:
    """The same scene by scene, with the interval of the hierarchical bootstrap; nothing without errors by scene."""
    others = [other for other in names.ordered_explorers(runs.explorers) if other != reference]
    found = {names.explorer(other): runs.scene_difference(other, reference, model) for other in others}
    known = [f"{name} {one.mean:+.1f} ± {one.half_width:.1f}" for name, one in found.items() if one]
    if known:
        yield (
            f"{names.model(model)}, the same with the same seed and scene (bootstrap over seeds and over the scenes of "
            f"each; too narrow where trainings differ more than scenes): {', '.join(known)}."
        )


def _shares_of_way(runs: ComparableRuns, names: DisplayNames, baselines: Sequence[str]) -> list[str]:
    """For each model how far the explorers come from a baseline's error to the ceiling's, a sentence each."""
    notes = []
    explorers = names.ordered_explorers(runs.explorers)
    references = [one for one in explorers if one.name in baselines]
    ceilings = [one for one in explorers if one.is_ceiling]
    for reference, ceiling, model in product(references, ceilings, names.ordered_models(runs.models)):
        others = [one for one in explorers if one != reference and not one.is_ceiling]
        found = {names.explorer(one): runs.share_of_way(one, reference, ceiling, model) for one in others}
        known = [f"{name} {100 * one.mean:.0f} ± {100 * one.half_width:.0f} %" for name, one in found.items() if one]
        if known:
            notes.append(
                f"{names.model(model)}, share of the way from {names.explorer(reference)}'s MAE to that of "
                f"{names.explorer(ceiling)} with the same seeds: {', '.join(known)}."
            )
    return notes


def _over_models(runs: ComparableRuns, explorer: Variant) -> tuple[frozenset[Variant], SeedErrors]:
    """The models that an explorer's errors are averaged over, and the means of each seed's errors over the seeds."""
    models_of_seed: dict[int, set[Variant]] = defaultdict(set)
    for (one, model), cell in runs.cells.items():
        for seed in cell if one == explorer else ():
            models_of_seed[seed].add(model)
    seeds_of_models: dict[frozenset[Variant], list[int]] = defaultdict(list)
    for seed, found in models_of_seed.items():
        seeds_of_models[frozenset(found)].append(seed)
    models = max(seeds_of_models, key=lambda some: (len(some), len(seeds_of_models[some]), sorted(some)))

    def mean(seed: int, metric: str) -> float:
        errors = [runs.cells[explorer, model][seed].errors[metric] for model in models]
        return sum(errors) / len(errors)

    return models, SeedErrors.over({s: {name: mean(s, name) for name in METRICS} for s in seeds_of_models[models]})


def _finished(
    table: ResultTable, shown: Iterable[ComparableRuns], notes: Sequence[str], rank_by_part: bool = False
) -> ResultTable:
    """The table with its ranks and the notes that all tables need."""
    seeds = ", ".join(map(str, table.usual_seeds))
    count = len(table.usual_seeds)
    general = [
        f"{_units()}; lower is better.",
        f"Mean and 95 % interval over n = {counted(count, 'seed')} ({seeds}) where a number says no others."
        if count > 1
        else f"One seed ({seeds}) each, so there are no intervals, where a number says no others.",
        "Bold: best, underlined: second best of the numbers over these seeds; interpolation is not ranked.",
    ]
    shown = list(shown)
    if any(explorer.is_ceiling for runs in shown for explorer in runs.explorers):
        general.append(
            "Free viewpoints are a ceiling and not ranked: no robot collected them, and true depth chose their source "
            "frames."
        )
    for runs in shown:
        if not runs.same_frames:
            general.append("Interpolation does not err alike in all runs: they were not tested on the same frames.")
        if runs.repeated:
            general.append(f"Runs that are there twice, with equal errors: {runs.repeated}; each counts once.")
    return replace(table, notes=(*notes, *general), units_in_headings=False).ranked(by_part=rank_by_part)


def _units() -> str:
    """The metrics and their units as one phrase: "MAE and RMSE in mm, iMAE and iRMSE in 1/km"."""
    titles: dict[str, list[str]] = defaultdict(list)
    for metric in METRICS.values():
        titles[metric.unit].append(metric.title)
    return ", ".join(f"{' and '.join(of_unit)} in {unit}" for unit, of_unit in titles.items())
