"""Runs that may stand in one table, their errors over the seeds, and which runs are missing among them."""

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
"""Relative difference of the baselines from which on the test frames are not the same."""

_SAME_ERRORS = 1e-3
"""Relative difference of the MAE from which on two results are not of one run."""

_AMOUNT = ("scenes.train", "collect.steps", "collect.episodes")
"""What decides on the number of training frames."""


@dataclass(frozen=True)
class SeedErrors:
    """The errors of an explorer and a depth model over the seeds.

    Args:
        seeds: that the means are over; empty for errors that no seed changes.
        estimates: mean and interval of each of `deux.metrics.depth_errors.METRICS`, by its name.
    """

    seeds: tuple[int, ...]
    estimates: Mapping[str, Estimate]

    @classmethod
    def over(cls, errors: Mapping[int, Mapping[str, float]]) -> "SeedErrors":
        """The means of each metric over the seeds, given the errors of each seed."""
        seeds = tuple(sorted(errors))
        return cls(seeds, {name: estimate([errors[seed][name] for seed in seeds]) for name in METRICS})


@dataclass(frozen=True)
class MissingRun:
    """A run that is not finished.

    Args:
        explorer: its explorer.
        model: its depth model.
        seed: its seed.
        begun: whether it was begun.
    """

    explorer: Variant
    model: Variant
    seed: int
    begun: bool


@dataclass(frozen=True)
class ComparableRuns:
    """Runs with equal training frames and budgets but for the explorer, and with the same test frames.

    Args:
        finished: the runs with results, each once.
        begun: the runs without.
        sweeps: the sweeps that any of them belongs to.
        repeated: number of runs that are there a second time, such as in a copy, with equal errors.
        presets: named sets of an explorer's options, whose names stand for them.
    """

    finished: tuple[Run, ...]
    begun: tuple[Run, ...]
    sweeps: tuple[Sweep, ...]
    repeated: int = 0
    presets: Mapping[str, FlatOptions] = field(default_factory=dict)

    @property
    def runs(self) -> tuple[Run, ...]:
        """All of them."""
        return (*self.finished, *self.begun)

    @property
    def training(self) -> FlatOptions:
        """What made the training frames, and the budget."""
        return self.runs[0].conditions.training

    @property
    def testing(self) -> FlatOptions:
        """What made the test frames."""
        return self.runs[0].conditions.testing

    @property
    def own_testing(self) -> FlatOptions:
        """What makes the test frames of the dataset that the models were trained on."""
        return self.runs[0].own_testing

    @property
    def budget(self) -> FlatOptions:
        """The part of the training that does not depend on the scenes."""
        return self.runs[0].conditions.budget

    @property
    def without_amount(self) -> tuple[FlatOptions, FlatOptions]:
        """Training and test frames without how much was explored: equal along a line of errors against frames."""
        return tuple(option for option in self.training if option[0] not in _AMOUNT), self.testing

    @property
    def transferred(self) -> bool:
        """Whether the models were tested on another dataset than they were trained on."""
        return other_scenes(self.testing, self.own_testing)

    @cached_property
    def cells(self) -> dict[tuple[Variant, Variant], dict[int, Run]]:
        """The finished runs by explorer and model, then by seed."""
        found: dict[tuple[Variant, Variant], dict[int, Run]] = defaultdict(dict)
        for run in self.finished:
            found[self.explorer(run), self.model(run)][run.conditions.seed] = run
        return dict(found)

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
        """How much higher an explorer's MAE is than another's with the same seed; None with fewer than two such seeds.

        What a seed does to all of them, such as the first weights, cancels out.
        """
        mine, theirs = (self.cells.get((one, model), {}) for one in (explorer, other))
        shared = [run.errors["mae"] - theirs[seed].errors["mae"] for seed, run in mine.items() if seed in theirs]
        return estimate(shared) if len(shared) > 1 else None

    def scene_difference(self, explorer: Variant, other: Variant, model: Variant) -> Estimate | None:
        """As `paired_difference`, scene by scene of each seed, with the interval of the hierarchical bootstrap.

        None with fewer than two seeds of both, where a run does not have the errors of its scenes, or of so few scenes
        that the bootstrap's interval is far too narrow: `least_scenes`.
        """
        mine, theirs = (self.cells.get((one, model), {}) for one in (explorer, other))
        shared = [_scene_differences(run, theirs[seed]) for seed, run in mine.items() if seed in theirs]
        if len(shared) < 2 or min(map(len, shared)) < least_scenes(shared):
            return None
        return scene_estimate(shared)

    @property
    def drawn_by_seed(self) -> bool:
        """Whether each seed has test scenes of its own."""
        return DRAWN_BY_SEED in self.testing

    def share_of_way(self, explorer: Variant, reference: Variant, ceiling: Variant, model: Variant) -> Estimate | None:
        """How far an explorer comes from the reference's MAE r to the ceiling's c: R = mean(r - x) / mean(r - c).

        Means are over the seeds that all three have. The interval is Student's t interval of the mean of
        (r - x) - R (r - c), divided by mean(r - c): the delta method for a ratio of paired means (Cochran, Sampling
        Techniques, 1977, section 2.11).

        Returns:
            None with fewer than two such seeds, or where r - c is not above 0 with 95 % confidence.
        """
        cells = [self.cells.get((one, model), {}) for one in (explorer, reference, ceiling)]
        seeds = sorted(set.intersection(*(set(cell) for cell in cells)))
        if len(seeds) < 2:
            return None
        x, r, c = (np.array([cell[seed].errors["mae"] for seed in seeds]) for cell in cells)
        whole = estimate(r - c)
        if not whole.mean > whole.half_width:
            return None
        share = float(np.mean(r - x)) / whole.mean
        return Estimate(share, estimate((r - x) - share * (r - c)).half_width / whole.mean)

    @property
    def baseline(self) -> SeedErrors:
        """The errors of interpolation: over the seeds where each has its own test scenes, else without an interval."""
        found = {
            seed: {name: sum(errors[name] for errors in alike) / len(alike) for name in METRICS}
            for seed, alike in self._baselines.items()
        }
        if self.drawn_by_seed:
            return SeedErrors.over(found)
        return SeedErrors((), {name: Estimate(errors[name]) for errors in found.values() for name in METRICS})

    @property
    def same_frames(self) -> bool:
        """Whether interpolation errs alike in all runs with the same test frames: of a seed, where it draws these."""
        errors = [[one["mae"] for one in alike] for alike in self._baselines.values()]
        return all(max(alike) - min(alike) <= _SAME_FRAMES * max(alike) for alike in errors)

    @property
    def _baselines(self) -> dict[int, list[dict[str, float]]]:
        """The interpolation's errors of the runs on the same test frames: by seed, or all below 0."""
        found: dict[int, list[dict[str, float]]] = defaultdict(list)
        for run in self.finished:
            if run.results:
                found[run.conditions.seed if self.drawn_by_seed else 0].append(run.results.baseline)
        return dict(sorted(found.items()))

    def explorer(self, run: Run) -> Variant:
        """The explorer of one of the runs."""
        name = str(run.conditions.explorer)
        return Variant(name, self._variant_labels[0][name][run.conditions.explorer_options])

    def model(self, run: Run) -> Variant:
        """The depth model of one of the runs."""
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
        """What the sweeps asked for, or the explorers, models and seeds that occur call for, and is not finished."""
        begun = {(self.explorer(run), self.model(run), run.conditions.seed) for run in self.begun}
        seeds = {run.conditions.seed for run in self.runs}
        expected = set(itertools.product(map(self.explorer, self.runs), map(self.model, self.runs), seeds))
        called: dict[Variant, set[str]] = defaultdict(
            set
        )  # a sweep names the preset that holds an explorer's options, or the explorer
        for run in self.runs:
            options = {*run.conditions.explorer_options}
            held = (name for name, preset in self.presets.items() if {*preset} <= options)
            called[self.explorer(run)] |= {str(run.conditions.explorer), *held}
        occurring = {(name, model.name, seed) for explorer, model, seed in expected for name in called[explorer]}
        for sweep in self.sweeps:
            asked = set(sweep.grid) - occurring
            expected |= {(Variant(explorer), Variant(model), seed) for explorer, model, seed in asked}
        expected -= {(*cell, seed) for cell, runs in self.cells.items() for seed in runs}
        return tuple(MissingRun(*wanted, begun=wanted in begun) for wanted in sorted(expected))


def group_comparable(
    found: FoundRuns, sweeps: Sequence[Sweep], presets: Mapping[str, FlatOptions] | None = None
) -> list[ComparableRuns]:
    """All groups of comparable runs with a finished one among them, those of the most explorers first.

    Of several with as many, those come first whose test frames are of a dataset from which models were taken to
    another one: it is the paper's first.

    Args:
        found: the runs.
        sweeps: that they may belong to.
        presets: named sets of an explorer's options.

    Raises:
        DeuxError: the same run is there twice with other errors.
    """
    groups: dict[tuple[FlatOptions, FlatOptions, FlatOptions], list[Run]] = defaultdict(list)
    for run in (*found.finished, *found.begun):
        groups[run.conditions.training, run.own_testing, run.conditions.testing].append(run)
    made = [
        replace(_without_repetitions(runs, sweeps), presets=presets or {})
        for runs in groups.values()
        if any(run.results for run in runs)
    ]
    taken_elsewhere = {group.own_testing for group in made if group.transferred}

    def order(group: ComparableRuns) -> tuple[int, bool, int, int, FlatOptions, FlatOptions]:
        at_home = group.testing not in taken_elsewhere
        plain = len(group.testing)  # a second dataset is the first one's scenes with options of its own
        return -len(group.explorers), at_home, -len(group.finished), plain, group.training, group.testing

    return sorted(made, key=order)


def _without_repetitions(runs: Sequence[Run], sweeps: Sequence[Sweep]) -> ComparableRuns:
    once: dict[Conditions, Run] = {}
    for run in sorted(runs, key=lambda run: (run.results is None, run.path)):
        _check_alike(once.setdefault(run.conditions, run), run)
    finished = tuple(run for run in once.values() if run.results)
    begun = tuple(run for run in once.values() if not run.results)
    folders = {run.path.parent for run in runs}
    own_sweeps = tuple(sweep for sweep in sweeps if sweep.folder in folders)
    return ComparableRuns(finished, begun, own_sweeps, sum(bool(run.results) for run in runs) - len(finished))


def _check_alike(one: Run, other: Run) -> None:
    """Raise DeuxError unless two finished runs with equal conditions err alike."""
    if one.results is None or other.results is None:
        return
    mine, theirs = one.errors["mae"], other.errors["mae"]
    if abs(mine - theirs) > _SAME_ERRORS * max(mine, theirs):
        raise DeuxError(
            f"{one.path} and {other.path} are the same run with other errors (MAE {mine:.1f} and {theirs:.1f} mm): "
            "keep one of them below the folder of the report."
        )


def _scene_differences(run: Run, other: Run) -> dict[str, SceneValue]:
    """How much higher a run's MAE is than another's on the test scenes of both, weighed by their frames.

    Results have a value for each floor; those of one scene are not independent and make one value.
    """
    assert run.results is not None
    assert other.results is not None
    theirs = {scene["scene"]: scene["metrics"]["mae"] for scene in other.results.scenes}
    floors: dict[str, list[SceneValue]] = defaultdict(list)
    for floor in run.results.scenes:
        if floor["scene"] in theirs:
            difference = floor["metrics"]["mae"] - theirs[floor["scene"]]
            floors[scene_of_place(floor["scene"])].append(SceneValue(difference, floor["frames"]))
    return {scene: _mean_value(values) for scene, values in floors.items()}


def _mean_value(values: Sequence[SceneValue]) -> SceneValue:
    """The weighted mean of the values, with the weight of them all."""
    frames = sum(value.weight for value in values)
    return SceneValue(sum(value.value * value.weight for value in values) / frames, frames)
