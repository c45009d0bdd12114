"""Runs that may stand in one table, and what is missing among them."""

import itertools
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from deux.metrics.depth_errors import METRIC_NAMES
from deux.report.conditions import Facts, variants
from deux.report.names import Key
from deux.report.runs import FoundRuns, Run
from deux.report.summary import Summary, summary
from deux.report.sweeps import Sweep

_SAME_FRAMES = 1e-3
"""Relative difference of the baselines from which on the test frames are not the same."""


_AMOUNT = ("scenes.train", "collect.steps", "collect.episodes")
"""What decides on the number of training frames."""


@dataclass(frozen=True)
class Missing:
    """A run that is not finished.

    Args:
        explorer: its explorer.
        model: its depth model.
        seed: its seed.
        begun: whether it was begun.
    """

    explorer: Key
    model: Key
    seed: int
    begun: bool


@dataclass(frozen=True)
class Comparison:
    """Runs with equal training frames and budgets but for the explorer, and with the same test frames.

    Args:
        finished: the runs with results; of runs that were done twice, the newest.
        begun: the runs without.
        sweeps: the sweeps that any of them belongs to.
        repeated: number of runs that were done twice.
    """

    finished: tuple[Run, ...]
    begun: tuple[Run, ...]
    sweeps: tuple[Sweep, ...]
    repeated: int = 0

    @property
    def training(self) -> Facts:
        """The training frames and the budget."""
        return (*self.finished, *self.begun)[0].conditions.training

    @property
    def testing(self) -> Facts:
        """The test frames."""
        return (*self.finished, *self.begun)[0].conditions.testing

    @property
    def own_testing(self) -> Facts:
        """The test frames of the dataset that the models were trained on."""
        return (*self.finished, *self.begun)[0].own_testing

    @property
    def budget(self) -> Facts:
        """The part of the training that does not depend on the scenes."""
        return (*self.finished, *self.begun)[0].conditions.budget

    @property
    def but_for_amount(self) -> tuple[Facts, Facts]:
        """The training and the test frames without how much was explored: what a line against frames holds fixed."""
        return tuple(fact for fact in self.training if fact[0] not in _AMOUNT), self.testing

    @property
    def transferred(self) -> bool:
        """Whether the models were tested on another dataset than they were trained on."""
        return self.testing != self.own_testing

    @cached_property
    def cells(self) -> dict[tuple[Key, Key], dict[int, Run]]:
        """The finished runs by explorer and model, then by seed."""
        found: dict[tuple[Key, Key], dict[int, Run]] = defaultdict(dict)
        for run in self.finished:
            found[self.explorer(run), self.model(run)][run.conditions.seed] = run
        return dict(found)

    @property
    def explorers(self) -> set[Key]:
        """The explorers of the finished runs."""
        return {explorer for explorer, _ in self.cells}

    @property
    def models(self) -> set[Key]:
        """The depth models of the finished runs."""
        return {model for _, model in self.cells}

    def errors(self, explorer: Key, model: Key) -> tuple[Summary, ...] | None:
        """The four errors of an explorer and a model over the seeds; None without a finished run."""
        runs = self.cells.get((explorer, model))
        if runs is None:
            return None
        return tuple(summary({seed: run.errors[name] for seed, run in runs.items()}) for name in METRIC_NAMES)

    def beyond(self, explorer: Key, other: Key, model: Key) -> Summary | None:
        """How much higher an explorer's MAE is than another's with the same seed; None with fewer than two such seeds.

        What a seed does to all of them, such as the first weights, cancels out.
        """
        mine, theirs = (self.cells.get((one, model), {}) for one in (explorer, other))
        shared = {seed: run.errors["mae"] - theirs[seed].errors["mae"] for seed, run in mine.items() if seed in theirs}
        return summary(shared) if len(shared) > 1 else None

    @property
    def baseline(self) -> tuple[Summary, ...]:
        """The four errors of interpolation on the test frames."""
        results = [run.results for run in self.finished if run.results]
        return tuple(Summary(sum(r.baseline[name] for r in results) / len(results), None) for name in METRIC_NAMES)

    @property
    def same_frames(self) -> bool:
        """Whether interpolation errs alike in all runs, as it must where the test frames are the same."""
        errors = [run.results.baseline["mae"] for run in self.finished if run.results]
        return max(errors) - min(errors) <= _SAME_FRAMES * max(errors)

    def explorer(self, run: Run) -> Key:
        """The explorer of one of the runs."""
        made_of = run.conditions
        return str(made_of.explorer), self._variants[0][str(made_of.explorer)][made_of.explorer_options]

    def model(self, run: Run) -> Key:
        """The depth model of one of the runs."""
        made_of = run.conditions
        return made_of.model, self._variants[1][made_of.model][made_of.model_options]

    @cached_property
    def _variants(self) -> tuple[dict[str, dict[Facts, str]], dict[str, dict[Facts, str]]]:
        explorers, models = defaultdict(list), defaultdict(list)
        for run in (*self.finished, *self.begun):
            explorers[str(run.conditions.explorer)].append(run.conditions.explorer_options)
            models[run.conditions.model].append(run.conditions.model_options)
        return (
            {name: variants(choices) for name, choices in explorers.items()},
            {name: variants(choices) for name, choices in models.items()},
        )

    @cached_property
    def missing(self) -> tuple[Missing, ...]:
        """What the sweeps asked for, or the explorers, models and seeds that occur call for, and is not finished."""
        runs = (*self.finished, *self.begun)
        begun = {(self.explorer(run), self.model(run), run.conditions.seed) for run in self.begun}
        seeds = {run.conditions.seed for run in runs}
        expected = set(itertools.product(map(self.explorer, runs), map(self.model, runs), seeds))
        occurring = {(explorer[0], model[0], seed) for explorer, model, seed in expected}
        for sweep in self.sweeps:
            asked = set(sweep.grid) - occurring
            expected |= {((explorer, ""), (model, ""), seed) for explorer, model, seed in asked}
        expected -= {(*cell, seed) for cell, runs_of in self.cells.items() for seed in runs_of}
        return tuple(Missing(*wanted, begun=wanted in begun) for wanted in sorted(expected))


def comparisons(found: FoundRuns, sweeps: Sequence[Sweep]) -> list[Comparison]:
    """All comparisons that have a finished run, the largest first."""
    groups: dict[tuple[Facts, Facts, Facts], list[Run]] = defaultdict(list)
    for run in (*found.finished, *found.begun):
        groups[run.conditions.training, run.own_testing, run.conditions.testing].append(run)
    made = [_comparison(runs, sweeps) for runs in groups.values() if any(run.results for run in runs)]
    return sorted(made, key=lambda c: (-len(c.explorers), -len(c.finished), c.training, c.testing))


def lone_sweeps(found: FoundRuns, sweeps: Iterable[Sweep]) -> list[Sweep]:
    """Sweeps of which no run is finished."""
    return [sweep for sweep in sweeps if not any(run.path.parent == sweep.folder for run in found.finished)]


def _comparison(runs: Sequence[Run], sweeps: Sequence[Sweep]) -> Comparison:
    newest: dict[tuple[object, ...], Run] = {}
    for run in sorted(runs, key=lambda run: (_written(run), run.path)):
        newest[_what(run)] = run
    finished = tuple(run for run in newest.values() if run.results)
    begun = tuple(run for run in newest.values() if not run.results)
    folders = {run.path.parent for run in runs}
    mine = tuple(sweep for sweep in sweeps if sweep.folder in folders)
    return Comparison(finished, begun, mine, sum(bool(run.results) for run in runs) - len(finished))


def _what(run: Run) -> tuple[object, ...]:
    made_of = run.conditions
    return made_of.explorer, made_of.explorer_options, made_of.model, made_of.model_options, made_of.seed


def _written(run: Run) -> float:
    """When the results were written; before all others where there are none."""
    return (run.path / "results.json").stat().st_mtime if run.results else 0.0
