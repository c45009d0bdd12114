"""What a report calls the datasets, and which of them is the paper's first."""

import json
from collections.abc import Sequence
from pathlib import Path

from deux.errors import DeuxError, near_matches
from deux.report.comparable_runs import ComparableRuns
from deux.report.conditions import FlatOptions, differences

_MOST_SCENES = 4
"""Scenes that a dataset's name lists; it counts them where there are more."""


class DatasetNames:
    """The datasets of some groups of runs, told apart by their test frames.

    Args:
        groups: in the order of `deux.report.comparable_runs.group_comparable`.
        first: the name of Table I's dataset; None for the one on which the most explorers were compared.

    Raises:
        DeuxError: there is no dataset of that name.
    """

    def __init__(self, groups: Sequence[ComparableRuns], first: str | None = None) -> None:
        self._names: dict[FlatOptions, str] = {}
        known = [group.testing for group in groups if not group.transferred]
        known += [testing for group in groups for testing in (group.own_testing, group.testing)]
        for testing in known:
            if testing not in self._names:
                self._names[testing] = self._new_name(testing)
        if first is not None and first not in self._names.values():
            raise DeuxError(
                f"report.first={first} is no dataset of these runs: {near_matches(first, self._names.values())}"
            )
        chosen = (testing for testing, name in self._names.items() if name == first)
        self.first = next(chosen, known[0] if known else ())

    def name(self, testing: FlatOptions) -> str:
        """What the dataset of some test frames is called."""
        return self._names[testing]

    def _new_name(self, testing: FlatOptions) -> str:
        """Its source, and what tells it from an earlier dataset of that source."""
        source = _source(testing)
        for other, name in self._names.items():
            if name == source:
                return f"{source} ({differences(testing, other)})"
        return source


def _source(testing: FlatOptions) -> str:
    """The folder of recorded data, or the source of the scenes, with the test scenes' names where they are chosen."""
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
