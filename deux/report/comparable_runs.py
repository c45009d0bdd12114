"""Groups of runs that can be compared in one table, with statistics over seeds and a list of missing runs."""

import itertools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from deux.collection.specification import scene_of_place
from deux.errors import DeuxError
from deux.metrics.depth_errors import METRICS
from deux.metrics.intervals import Estimate, estimate
from deux.metrics.scene_bootstrap import SceneValue, least_scenes, scene_estimate
from deux.report.conditions import DRAWN_BY_SEED, Conditions, FlatOptions, other_scenes, variant_labels
from deux.report.display_names import Variant
from deux.report.runs import FoundRuns, Run
from deux.report.sweeps import Sweep

_SAME_FRAMES = 1e-3
"""Maximal relative difference between the baselines of runs with the same test frames."""

_SAME_ERRORS = 1e-3
"""Maximal relative difference between the MAE of two copies of a run."""

_AMOUNT = ("scenes.train", "collect.steps", "collect.episodes")
"""Options that determine the number of training frames."""


@dataclass(frozen=True)
class SeedErrors:
    """Mean errors over seeds.

    Args:
        seeds: the seeds; empty for errors that do not depend on the seed.
        estimates: mean and confidence interval of each metric of `deux.metrics.depth_errors.METRICS`, by its name.
    """

    seeds: tuple[int, ...]
    estimates: Mapping[str, Estimate]

    @classmethod
    def over(cls, errors: Mapping[int, Mapping[str, float]]) -> "SeedErrors":
        """Compute mean and interval of each metric from the errors by seed."""
        seeds = tuple(sorted(errors))
        return cls(seeds, {name: estimate([errors[seed][name] for seed in seeds]) for name in METRICS})


@dataclass(frozen=True)
class MissingRun:
    """An expected run that is not finished.

    Args:
        explorer: its explorer.
        model: its depth model.
        seed: its seed.
        started: whether it was started.
    """

    explorer: Variant
    model: Variant
    seed: int
    started: bool


@dataclass(frozen=True)
class ComparableRuns:
    """Runs with the same test frames that differ only in explorer, depth model and seed.

    Args:
        finished: runs with results, without duplicates.
        unfinished: runs without results.
        sweeps: sweeps that the runs belong to.
        duplicates: number of runs that were left out as duplicates with equal errors, such as copies.
        presets: named sets of explorer options; the tables show their names instead of the options.
    """

    finished: tuple[Run, ...]
    unfinished: tuple[Run, ...]
    sweeps: tuple[Sweep, ...]
    duplicates: int = 0
    presets: Mapping[str, FlatOptions] = field(default_factory=dict)

    @property
    def runs(self) -> tuple[Run, ...]:
        """Finished and unfinished runs."""
        return (*self.finished, *self.unfinished)

    @property
    def training(self) -> FlatOptions:
        """Options that determine the training frames, and the budget."""
        return self.runs[0].conditions.training

    @property
    def testing(self) -> FlatOptions:
        """Options that determine the test frames."""
        return self.runs[0].conditions.testing

    @property
    def own_testing(self) -> FlatOptions:
        """Options that determine the test frames of the dataset on which the models were trained."""
        return self.runs[0].own_testing

    @property
    def budget(self) -> FlatOptions:
        """Options of the training that do not depend on the scenes."""
        return self.runs[0].conditions.budget

    @property
    def without_amount(self) -> tuple[FlatOptions, FlatOptions]:
        """Options of training and test without those for the number of training frames.

        Groups for which this is equal form a curve of error against number of frames.
        """
        return tuple(option for option in self.training if option[0] not in _AMOUNT), self.testing

    @property
    def transferred(self) -> bool:
        """Whether the models were tested on another dataset than they were trained on."""
        return other_scenes(self.testing, self.own_testing)

    @cached_property
    def cells(self) -> dict[tuple[Variant, Variant], dict[int, Run]]:
        """The finished runs by explorer and model, then by seed."""
        cells: dict[tuple[Variant, Variant], dict[int, Run]] = defaultdict(dict)
        for run in self.finished:
            cells[self.explorer(run), self.model(run)][run.conditions.seed] = run
        return dict(cells)

    @property
    def explorers(self) -> set[Variant]:
        """The explorers of the finished runs."""
        return {explorer for explorer, _ in self.cells}

    @property
    def models(self) -> set[Variant]:
        """The depth models of the finished runs."""
        return {model for _, model in self.cells}

    def errors(self, explorer: Variant, model: Variant) -> SeedErrors | None:
        """The errors of an explorer and a model over the seeds; None without a finished run."""
        runs = self.cells.get((explorer, model))
        return SeedErrors.over({seed: run.errors for seed, run in runs.items()}) if runs else None

    def paired_difference(self, explorer: Variant, other: Variant, model: Variant) -> Estimate | None:
        """Mean difference of the MAE of two explorers with the same seed, `explorer` minus `other`.

        Pairing by seed cancels effects of the seed on both, such as those of the initial weights.

        Returns:
            None if fewer than two seeds are shared.
        """
        runs, other_runs = (self.cells.get((variant, model), {}) for variant in (explorer, other))
        differences = [run.errors["mae"] - other_runs[s].errors["mae"] for s, run in runs.items() if s in other_runs]
        return estimate(differences) if len(differences) > 1 else None

    def scene_difference(self, explorer: Variant, other: Variant, model: Variant) -> Estimate | None:
        """Like `paired_difference`, but paired by seed and scene, with the interval of the hierarchical bootstrap.

        Returns:
            None if fewer than two seeds are shared, or if a run has no errors by scene, or too few scenes for the
            bootstrap (`least_scenes`).
        """
        runs, other_runs = (self.cells.get((variant, model), {}) for variant in (explorer, other))
        differences = [_scene_differences(run, other_runs[seed]) for seed, run in runs.items() if seed in other_runs]
        if len(differences) < 2 or min(map(len, differences)) < least_scenes(differences):
            return None
        return scene_estimate(differences)

    @property
    def drawn_by_seed(self) -> bool:
        """Whether the seed determines the test scenes."""
        return DRAWN_BY_SEED in self.testing

    def relative_gain(self, explorer: Variant, reference: Variant, ceiling: Variant, model: Variant) -> Estimate | None:
        """Gain in MAE over a reference, relative to that of the ceiling: R = mean(r - x) / mean(r - c).

        Here, x, r and c are the MAE of explorer, reference and ceiling, and the means are over the seeds that all three
        have. The interval is Student's t interval of the mean of (r - x) - R (r - c), divided by mean(r - c): the delta
        method for a ratio of paired means (Cochran, Sampling Techniques, 1977, section 2.11).

        Returns:
            None with fewer than two such seeds, or if r - c is not above 0 with 95 % confidence.
        """
        cells = [self.cells.get((variant, model), {}) for variant in (explorer, reference, ceiling)]
        seeds = sorted(set.intersection(*(set(cell) for cell in cells)))
        if len(seeds) < 2:
            return None
        x, r, c = (np.array([cell[seed].errors["mae"] for seed in seeds]) for cell in cells)
        whole = estimate(r - c)
        if not whole.mean > whole.half_width:
            return None
        ratio = float(np.mean(r - x)) / whole.mean
        return Estimate(ratio, estimate((r - x) - ratio * (r - c)).half_width / whole.mean)

    @property
    def baseline(self) -> SeedErrors:
        """The errors of interpolation; with intervals over the seeds only if the seed determines the test scenes."""
        means = {
            seed: {name: sum(errors[name] for errors in baselines) / len(baselines) for name in METRICS}
            for seed, baselines in self._baselines.items()
        }
        if self.drawn_by_seed:
            return SeedErrors.over(means)
        return SeedErrors((), {name: Estimate(errors[name]) for errors in means.values() for name in METRICS})

    @property
    def same_frames(self) -> bool:
        """Whether the runs were tested on the same frames, judged by the errors of interpolation."""
        maes = [[errors["mae"] for errors in baselines] for baselines in self._baselines.values()]
        return all(max(values) - min(values) <= _SAME_FRAMES * max(values) for values in maes)

    @property
    def _baselines(self) -> dict[int, list[dict[str, float]]]:
        """The errors of interpolation, by seed if it determines the test scenes, else all under 0."""
        baselines: dict[int, list[dict[str, float]]] = defaultdict(list)
        for run in self.finished:
            if run.results:
                baselines[run.conditions.seed if self.drawn_by_seed else 0].append(run.results.baseline)
        return dict(sorted(baselines.items()))

    def explorer(self, run: Run) -> Variant:
        """The explorer of a run of this group."""
        name = str(run.conditions.explorer)
        return Variant(name, self._variant_labels[0][name][run.conditions.explorer_options])

    def model(self, run: Run) -> Variant:
        """The depth model of a run of this group."""
        name = run.conditions.model
        return Variant(name, self._variant_labels[1][name][run.conditions.model_options])

    @cached_property
    def _variant_labels(self) -> tuple[dict[str, dict[FlatOptions, str]], dict[str, dict[FlatOptions, str]]]:
        """The labels of explorers and of models, by name and options."""
        explorers, models = defaultdict(list), defaultdict(list)
        for run in self.runs:
            explorers[str(run.conditions.explorer)].append(run.conditions.explorer_options)
            models[run.conditions.model].append(run.conditions.model_options)
        return (
            {name: variant_labels(choices, self.presets) for name, choices in explorers.items()},
            {name: variant_labels(choices) for name, choices in models.items()},
        )

    @cached_property
    def missing(self) -> tuple[MissingRun, ...]:
        """Expected runs that are not finished.

        Expected are the runs of the sweeps, and every combination of the explorers, models and seeds that occur.
        """
        started = {(self.explorer(run), self.model(run), run.conditions.seed) for run in self.unfinished}
        seeds = {run.conditions.seed for run in self.runs}
        expected = set(itertools.product(map(self.explorer, self.runs), map(self.model, self.runs), seeds))
        # A sweep gives an explorer by its name, or by that of a preset that contains its options.
        names: dict[Variant, set[str]] = defaultdict(set)
        for run in self.runs:
            options = {*run.conditions.explorer_options}
            matching = (name for name, preset in self.presets.items() if {*preset} <= options)
            names[self.explorer(run)] |= {str(run.conditions.explorer), *matching}
        occurring = {(name, model.name, seed) for explorer, model, seed in expected for name in names[explorer]}
        for sweep in self.sweeps:
            new = set(sweep.grid) - occurring
            expected |= {(Variant(explorer), Variant(model), seed) for explorer, model, seed in new}
        expected -= {(*cell, seed) for cell, runs in self.cells.items() for seed in runs}
        return tuple(MissingRun(*run, started=run in started) for run in sorted(expected))


def group_comparable(
    found: FoundRuns, sweeps: Sequence[Sweep], presets: Mapping[str, FlatOptions] | None = None
) -> list[ComparableRuns]:
    """Group runs that can be compared; groups without a finished run are left out.

    Groups with more explorers come first. Among those with equally many, groups on a dataset whose models were
    transferred to another one come first, like the paper's first dataset.

    Args:
        found: the runs.
        sweeps: sweeps that the runs may belong to.
        presets: named sets of explorer options.

    Raises:
        DeuxError: there are two copies of a run with different errors.
    """
    members: dict[tuple[FlatOptions, FlatOptions, FlatOptions], list[Run]] = defaultdict(list)
    for run in (*found.finished, *found.unfinished):
        members[run.conditions.training, run.own_testing, run.conditions.testing].append(run)
    groups = [
        replace(_without_duplicates(runs, sweeps), presets=presets or {})
        for runs in members.values()
        if any(run.results for run in runs)
    ]
    transferred_from = {group.own_testing for group in groups if group.transferred}

    def order(group: ComparableRuns) -> tuple[int, bool, int, int, FlatOptions, FlatOptions]:
        not_transferred = group.testing not in transferred_from
        options = len(group.testing)  # a second dataset may have the first one's scenes with additional options
        return -len(group.explorers), not_transferred, -len(group.finished), options, group.training, group.testing

    return sorted(groups, key=order)


def _without_duplicates(runs: Sequence[Run], sweeps: Sequence[Sweep]) -> ComparableRuns:
    unique: dict[Conditions, Run] = {}
    for run in sorted(runs, key=lambda run: (run.results is None, run.path)):
        _check_equal_errors(unique.setdefault(run.conditions, run), run)
    finished = tuple(run for run in unique.values() if run.results)
    unfinished = tuple(run for run in unique.values() if not run.results)
    folders = {run.path.parent for run in runs}
    own_sweeps = tuple(sweep for sweep in sweeps if sweep.folder in folders)
    return ComparableRuns(finished, unfinished, own_sweeps, sum(bool(run.results) for run in runs) - len(finished))


def _check_equal_errors(first: Run, second: Run) -> None:
    """Raise DeuxError if two finished runs with equal conditions have different errors."""
    if first.results is None or second.results is None:
        return
    one, other = first.errors["mae"], second.errors["mae"]
    if abs(one - other) > _SAME_ERRORS * max(one, other):
        raise DeuxError(
            f"{first.path} and {second.path} are the same run with different errors (MAE {one:.1f} and {other:.1f} mm):"
            " remove one of them from the folder of the report."
        )


def _scene_differences(run: Run, other: Run) -> dict[str, SceneValue]:
    """Difference of the MAE of two runs on each test scene that both have, weighted by the number of frames.

    Results have a value for each floor; the floors of a scene are not independent and are merged into one value.
    """
    assert run.results is not None
    assert other.results is not None
    other_maes = {scene["scene"]: scene["metrics"]["mae"] for scene in other.results.scenes}
    floors: dict[str, list[SceneValue]] = defaultdict(list)
    for floor in run.results.scenes:
        if floor["scene"] in other_maes:
            difference = floor["metrics"]["mae"] - other_maes[floor["scene"]]
            floors[scene_of_place(floor["scene"])].append(SceneValue(difference, floor["frames"]))
    return {scene: _mean_value(values) for scene, values in floors.items()}


def _mean_value(values: Sequence[SceneValue]) -> SceneValue:
    """The weighted mean of several values, with the sum of their weights."""
    frames = sum(value.weight for value in values)
    return SceneValue(sum(value.value * value.weight for value in values) / frames, frames)
