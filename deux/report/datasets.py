"""What a report calls the datasets, and which of them is the paper's first."""

import json
from collections.abc import Sequence
from pathlib import Path

from deux.errors import DeuxError, near_matches
from deux.report.comparison import Comparison
from deux.report.conditions import Facts, differences


class Datasets:
    """The datasets of some comparisons, told apart by their test frames.

    Args:
        comparisons: the largest first.
        first: the name of Table I's dataset; None for the one on which the most explorers were compared.

    Raises:
        DeuxError: there is no dataset of that name.
    """

    def __init__(self, comparisons: Sequence[Comparison], first: str | None = None) -> None:
        self._names: dict[Facts, str] = {}
        known = [c.testing for c in comparisons if not c.transferred]
        known += [testing for c in comparisons for testing in (c.own_testing, c.testing)]
        for testing in known:
            if testing not in self._names:
                self._names[testing] = self._new_name(testing)
        if first is not None and first not in self._names.values():
            raise DeuxError(
                f"report.first={first} is no dataset of these runs: {near_matches(first, self._names.values())}"
            )
        chosen = (testing for testing, name in self._names.items() if name == first)
        self.first = next(chosen, known[0] if known else ())

    def name(self, testing: Facts) -> str:
        """What a dataset is called."""
        return self._names[testing]

    def _new_name(self, testing: Facts) -> str:
        """Its source, and what tells it from an earlier dataset of that source."""
        source = _source(testing)
        for other, name in self._names.items():
            if name == source:
                return f"{source} ({differences(testing, other)})"
        return source


def _source(testing: Facts) -> str:
    options = {key: json.loads(value) for key, value in testing}
    if data := options.get("evaluation.data"):
        return Path(str(data)).name
    source = str(options.get("scenes.source", "unknown scenes"))
    files = options.get("scenes.test", [])
    if source != "files":
        return source
    return f"{source} {', '.join(Path(str(file)).stem for file in ([files] if isinstance(files, str) else files))}"
