"""Display names of the datasets in a report, and the choice of the first dataset."""

import json
from collections.abc import Sequence
from pathlib import Path

from deux.errors import DeuxError, near_matches
from deux.report.comparable_runs import ComparableRuns
from deux.report.conditions import FlatOptions, differences

_MOST_SCENES = 4
"""Maximal number of scenes that are listed in a dataset's name; only the number of more scenes is shown."""


class DatasetNames:
    """Names the datasets of several groups of runs, identified by their test frames.

    Args:
        groups: the groups, in the order of `deux.report.comparable_runs.group_comparable`.
        first: name of Table I's dataset; None for the one on which the most explorers were compared.

    Raises:
        DeuxError: there is no dataset with the name `first`.
    """

    def __init__(self, groups: Sequence[ComparableRuns], first: str | None = None) -> None:
        self._names: dict[FlatOptions, str] = {}
        datasets = [group.testing for group in groups if not group.transferred]
        datasets += [testing for group in groups for testing in (group.own_testing, group.testing)]
        for testing in datasets:
            if testing not in self._names:
                self._names[testing] = self._new_name(testing)
        if first is not None and first not in self._names.values():
            raise DeuxError(
                f"report.first={first} is not a dataset of these runs: {near_matches(first, self._names.values())}"
            )
        chosen = (testing for testing, name in self._names.items() if name == first)
        self.first = next(chosen, datasets[0] if datasets else ())

    def name(self, testing: FlatOptions) -> str:
        """The display name of the dataset with these test frames."""
        return self._names[testing]

    def _new_name(self, testing: FlatOptions) -> str:
        """The dataset's source, and how its options differ from an earlier dataset of the same source."""
        source = _source(testing)
        for other, name in self._names.items():
            if name == source:
                return f"{source} ({differences(testing, other)})"
        return source


def _source(testing: FlatOptions) -> str:
    """The folder of recorded frames, or the scene source with the test scenes' names if these are chosen."""
    options = {key: json.loads(value) for key, value in testing}
    if data := options.get("evaluation.data"):
        return Path(str(data)).name
    source = str(options.get("scenes.name", "unknown scenes"))
    chosen = options.get("scenes.test")
    scenes = [chosen] if isinstance(chosen, str) else chosen if isinstance(chosen, list) else []
    names = [Path(scene).stem for scene in scenes if isinstance(scene, str)]
    if not names:
        return source
    return f"{source} {', '.join(names) if len(names) <= _MOST_SCENES else f'{len(names)} scenes'}"
