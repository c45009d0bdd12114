"""Tables I, II and III of the paper, from groups of comparable runs."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

from deux.errors import counted
from deux.metrics.depth_errors import METRICS
from deux.metrics.intervals import Estimate
from deux.metrics.tables import Cell, ResultTable, Row, error_columns
from deux.report.comparable_runs import ComparableRuns, SeedErrors
from deux.report.display_names import DisplayNames, Variant

INTERPOLATION = "Interpolation"
"""Label of the row of linear interpolation of the sparse points, which is not ranked."""


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
        names: display names of rows and columns.
        dataset: display name of the dataset.
        name: name of the table's files.
        baseline: explorers that the others are compared with in notes, seed by seed; None for no such notes. The first
            one is the reference of gains relative to the ceiling.
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
    notes = [*_paired_differences(runs, names, baselines), *_relative_gains(runs, names, baselines[:1])]
    return _rank_and_annotate(table, [runs], notes)


def table_two(
    runs: ComparableRuns,
    from_first: Sequence[ComparableRuns],
    names: DisplayNames,
    datasets: tuple[str, str],
    starred: Sequence[str],
    name: str = "table2",
) -> ResultTable:
    """Table II: explorers on another dataset, together with models that were trained on the first dataset.

    Args:
        runs: runs that were trained and tested on the other dataset.
        from_first: runs that were trained on the first dataset and tested on the same frames as `runs`.
        names: display names of the rows.
        datasets: display names of the first and the other dataset.
        starred: explorers whose models from the first dataset are shown; all if there are no such runs.
        name: name of the table's files.
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
            shown = [variant for variant in group.explorers if variant.name in starred] or group.explorers
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
    return _rank_and_annotate(table, [runs, *from_first], notes, rank_by_part=True)


def table_three(
    runs: ComparableRuns, names: DisplayNames, trained_on: str, tested_on: str, name: str = "table3"
) -> ResultTable:
    """Table III: zero-shot transfer, every explorer averaged over the models.

    The mean is over the seeds for which there is a run with every model. If there is no such seed, the mean is over the
    largest set of models with a common seed, and over the seeds with exactly this set; such a row lists the models and
    is not ranked.

    Args:
        runs: runs whose models were tested on another dataset than they were trained on.
        names: display names of rows and models.
        trained_on: display name of the training dataset.
        tested_on: display name of the test dataset.
        name: name of the table's files.
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
    notes = [f"Every number is the mean over {', '.join(names.model(model) for model in models)}."]
    return _rank_and_annotate(table, [runs], notes)


def _cells(errors: SeedErrors | None) -> tuple[Cell, ...]:
    """A cell for each metric; empty cells without errors."""
    if errors is None:
        return (Cell(),) * len(METRICS)
    return tuple(Cell(errors.estimates[name], seeds=errors.seeds) for name in METRICS)


def _paired_differences(runs: ComparableRuns, names: DisplayNames, baselines: Sequence[str]) -> list[str]:
    """Notes on the paired differences to the baselines' MAE, for each model."""
    notes = []
    explorers = names.ordered_explorers(runs.explorers)
    for reference in (explorer for explorer in explorers if explorer.name in baselines):
        others = [other for other in explorers if other != reference]
        for model in names.ordered_models(runs.models):
            by_seed = {other: runs.paired_difference(other, reference, model) for other in others}
            if text := _listed(by_seed, names):
                notes.append(
                    f"{names.model(model)}, difference to {names.explorer(reference)}'s MAE with the same seed (below "
                    f"0 is better; Student's t over the seeds): {text}."
                )
            by_scene = {other: runs.scene_difference(other, reference, model) for other in others}
            if text := _listed(by_scene, names):
                notes.append(
                    f"{names.model(model)}, the same with the same seed and scene (bootstrap over seeds and over the "
                    f"scenes of each; too narrow where trainings differ more than scenes): {text}."
                )
    return notes


def _listed(differences: Mapping[Variant, Estimate | None], names: DisplayNames) -> str:
    return ", ".join(
        f"{names.explorer(explorer)} {difference.mean:+.1f} ± {difference.half_width:.1f}"
        for explorer, difference in differences.items()
        if difference
    )


def _relative_gains(runs: ComparableRuns, names: DisplayNames, baselines: Sequence[str]) -> list[str]:
    """Notes on the explorers' gains over a baseline, relative to the ceiling's gain, for each model."""
    notes = []
    explorers = names.ordered_explorers(runs.explorers)
    references = [explorer for explorer in explorers if explorer.name in baselines]
    ceilings = [explorer for explorer in explorers if explorer.is_ceiling]
    for reference, ceiling, model in product(references, ceilings, names.ordered_models(runs.models)):
        others = [explorer for explorer in explorers if explorer != reference and not explorer.is_ceiling]
        gains = {other: runs.relative_gain(other, reference, ceiling, model) for other in others}
        text = ", ".join(
            f"{names.explorer(other)} {100 * gain.mean:.0f} ± {100 * gain.half_width:.0f} %"
            for other, gain in gains.items()
            if gain
        )
        if text:
            notes.append(
                f"{names.model(model)}, share of the way from {names.explorer(reference)}'s MAE to that of "
                f"{names.explorer(ceiling)} with the same seeds: {text}."
            )
    return notes


def _over_models(runs: ComparableRuns, explorer: Variant) -> tuple[frozenset[Variant], SeedErrors]:
    """Average an explorer's errors over models, then over seeds; returns the models and the errors."""
    models_of_seed: dict[int, set[Variant]] = defaultdict(set)
    for (other, model), cell in runs.cells.items():
        for seed in cell if other == explorer else ():
            models_of_seed[seed].add(model)
    seeds_of_models: dict[frozenset[Variant], list[int]] = defaultdict(list)
    for seed, members in models_of_seed.items():
        seeds_of_models[frozenset(members)].append(seed)
    models = max(seeds_of_models, key=lambda group: (len(group), len(seeds_of_models[group]), sorted(group)))

    def mean(seed: int, metric: str) -> float:
        errors = [runs.cells[explorer, model][seed].errors[metric] for model in models]
        return sum(errors) / len(errors)

    return models, SeedErrors.over({s: {name: mean(s, name) for name in METRICS} for s in seeds_of_models[models]})


def _rank_and_annotate(
    table: ResultTable, groups: Sequence[ComparableRuns], notes: Sequence[str], rank_by_part: bool = False
) -> ResultTable:
    """Rank a table's numbers and add the notes that are common to all tables."""
    seeds = ", ".join(map(str, table.usual_seeds))
    count = len(table.usual_seeds)
    general = [
        f"{_units()}; lower is better.",
        f"Mean and 95 % interval over n = {counted(count, 'seed')} ({seeds}) unless a number lists other seeds."
        if count > 1
        else f"One seed ({seeds}), thus without intervals, unless a number lists other seeds.",
        "Bold: best, underlined: second best of the numbers over these seeds; interpolation is not ranked.",
    ]
    if any(explorer.is_ceiling for runs in groups for explorer in runs.explorers):
        general.append(
            "Free viewpoints are a ceiling and not ranked: no robot collected them, and their source frames were "
            "chosen by true depth."
        )
    for runs in groups:
        if not runs.same_frames:
            general.append("Not all runs were tested on the same frames: the errors of interpolation differ.")
        if runs.duplicates:
            general.append(f"Duplicate runs with equal errors, which are counted once: {runs.duplicates}.")
    return replace(table, notes=(*notes, *general), units_in_headings=False).ranked(by_part=rank_by_part)


def _units() -> str:
    """The metrics with their units: "MAE and RMSE in mm, iMAE and iRMSE in 1/km"."""
    titles: dict[str, list[str]] = defaultdict(list)
    for metric in METRICS.values():
        titles[metric.unit].append(metric.title)
    return ", ".join(f"{' and '.join(metrics)} in {unit}" for unit, metrics in titles.items())
