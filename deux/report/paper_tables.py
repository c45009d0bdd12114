"""Tables I, II and III of the paper, from comparisons."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

from deux.metrics.depth_errors import METRIC_NAMES
from deux.report.comparison import Comparison
from deux.report.names import Key, Names
from deux.report.summary import Summary, summary
from deux.report.tables import Row, Table

INTERPOLATION = "Interpolation"
"""What the row of linear interpolation of the sparse points is called; it learns nothing and is not ranked."""


def table_one(
    comparison: Comparison, names: Names, dataset: str, name: str = "table1", baseline: str | None = None
) -> Table:
    """Table I: every explorer and every depth model on the test split of one dataset.

    Args:
        comparison: the runs.
        names: of rows and columns.
        dataset: what the dataset is called.
        name: of the table's files.
        baseline: an explorer that a note compares the others with, seed by seed; None for no such note.
    """
    models = names.ordered_models(comparison.models)
    nothing: tuple[None, ...] = (None,) * len(METRIC_NAMES)
    parts: list[tuple[Row, ...]] = [(Row((INTERPOLATION,), comparison.baseline * len(models), ranked=False),)]
    for part in names.explorer_parts(comparison.explorers):
        rows = []
        for explorer in part:
            numbers = [comparison.errors(explorer, model) or nothing for model in models]
            rows.append(Row((names.explorer(explorer),), tuple(n for four in numbers for n in four)))
        parts.append(tuple(rows))
    caption = f"Depth completion on the {dataset} test set"
    groups = tuple(names.model(model) for model in models)
    table = Table(name, caption, ("Exploration",), groups, tuple(parts))
    return _noted(table, [comparison], _beyond(comparison, names, baseline))


def table_two(
    comparison: Comparison,
    from_first: Sequence[Comparison],
    names: Names,
    datasets: tuple[str, str],
    starred: Sequence[str],
    name: str = "table2",
) -> Table:
    """Table II: explorers on another dataset, and beside them models that were trained on the first dataset.

    Args:
        comparison: trained and tested on the other dataset.
        from_first: trained on the first dataset, tested on the same frames as `comparison`.
        names: of rows.
        datasets: what the first and the other dataset are called.
        starred: explorers of which the models from the first dataset are shown; all, if none of these is there.
        name: of the table's files.
    """
    first, other = datasets
    parts: list[tuple[Row, ...]] = [(Row((INTERPOLATION, ""), comparison.baseline, ranked=False),)]
    models = comparison.models.union(*(c.models for c in from_first))
    for model in names.ordered_models(models):
        rows = []
        for explorer in names.ordered_explorers(comparison.explorers):
            if numbers := comparison.errors(explorer, model):
                rows.append(Row((names.model(model), names.explorer(explorer)), numbers))
        for transfer in from_first:
            shown = [e for e in transfer.explorers if e[0] in starred] or transfer.explorers
            for explorer in names.ordered_explorers(shown):
                if numbers := transfer.errors(explorer, model):
                    rows.append(Row((names.model(model), f"{names.explorer(explorer)}*"), numbers))
        parts.append(tuple(rows))
    caption = f"Depth completion on the {other} test set"
    notes = [f"*: trained on {first}."] if from_first else []
    table = Table(name, caption, ("Depth model", "Exploration"), ("",), tuple(parts), ranked_by_part=True)
    return _noted(table, [comparison, *from_first], notes)


def table_three(comparison: Comparison, names: Names, trained_on: str, tested_on: str, name: str = "table3") -> Table:
    """Table III: zero-shot transfer, every explorer averaged over the models.

    A seed counts if all models have it. Where no seed has all, the mean is over the models that most seeds have; such a
    row says over which, and is not ranked.
    """
    models = names.ordered_models(comparison.models)
    parts: list[tuple[Row, ...]] = [(Row((INTERPOLATION,), comparison.baseline, ranked=False),)]
    for part in names.explorer_parts(comparison.explorers):
        rows = []
        for explorer in part:
            averaged, numbers = _over_models(comparison, explorer)
            label = names.explorer(explorer)
            if len(averaged) < len(models):
                label += f" ({', '.join(names.model(m) for m in names.ordered_models(averaged))} only)"
            rows.append(Row((label,), numbers, ranked=len(averaged) == len(models)))
        parts.append(tuple(rows))
    caption = f"Zero-shot transfer: trained on {trained_on}, tested on {tested_on}"
    notes = [f"Every number is the mean over {', '.join(names.model(model) for model in models)}."]
    return _noted(Table(name, caption, ("Exploration",), ("",), tuple(parts)), [comparison], notes)


def _beyond(comparison: Comparison, names: Names, baseline: str | None) -> list[str]:
    """For each model how much higher than the baseline's the explorers' errors are, a sentence each."""
    notes = []
    for key in (key for key in names.ordered_explorers(comparison.explorers) if key[0] == baseline):
        for model in names.ordered_models(comparison.models):
            others = [other for other in names.ordered_explorers(comparison.explorers) if other != key]
            found = {names.explorer(other): comparison.beyond(other, key, model) for other in others}
            known = [f"{name} {n.mean:+.1f} ± {n.interval:.1f}" for name, n in found.items() if n]
            if known:
                notes.append(
                    f"{names.model(model)}, MAE beyond {names.explorer(key)}'s with the same seed (below 0 is better): "
                    f"{', '.join(known)}."
                )
    return notes


def _over_models(comparison: Comparison, explorer: Key) -> tuple[frozenset[Key], tuple[Summary, ...]]:
    """The models that an explorer's errors are averaged over, and the errors."""
    of_seed: dict[int, set[Key]] = defaultdict(set)
    for (one, model), runs in comparison.cells.items():
        for seed in runs if one == explorer else ():
            of_seed[seed].add(model)
    seeds_of: dict[frozenset[Key], list[int]] = defaultdict(list)
    for seed, models in of_seed.items():
        seeds_of[frozenset(models)].append(seed)
    models_of = max(seeds_of, key=lambda m: (len(m), len(seeds_of[m]), sorted(m)))

    def mean(seed: int, metric: str) -> float:
        errors = [comparison.cells[explorer, model][seed].errors[metric] for model in models_of]
        return sum(errors) / len(errors)

    seeds = sorted(seeds_of[models_of])
    return models_of, tuple(summary({seed: mean(seed, metric) for seed in seeds}) for metric in METRIC_NAMES)


def _noted(table: Table, shown: Iterable[Comparison], notes: Sequence[str] = ()) -> Table:
    """The table with the notes that all tables need."""
    seeds = ", ".join(map(str, table.usual_seeds))
    count = len(table.usual_seeds)
    general = [
        "MAE and RMSE in mm, iMAE and iRMSE in 1/km; lower is better.",
        f"Mean and 95 % interval over n = {count} seed{'s' * (count != 1)} ({seeds}) where a number says no other n."
        if count > 1
        else f"One seed ({seeds}) each, so there are no intervals, where a number says no other n.",
        "Bold: best; underlined: second best; interpolation of the sparse points is not ranked.",
    ]
    for comparison in shown:
        if not comparison.same_frames:
            general.append("Interpolation does not err alike in all runs: they were not tested on the same frames.")
        if comparison.repeated:
            general.append(f"Runs that were done twice: {comparison.repeated}; the newest counts.")
    return replace(table, notes=(*notes, *general))
