"""Timing that states its spread."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Timing:
    """Durations of repeated calls in seconds."""

    durations: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median duration in seconds."""
        return statistics.median(self.durations)

    @property
    def spread(self) -> tuple[float, float]:
        """10th and 90th percentile of the durations in seconds."""
        ordered = sorted(self.durations)
        last = len(ordered) - 1
        return ordered[round(0.1 * last)], ordered[round(0.9 * last)]

    def rate(self, work: int = 1) -> str:
        """`work` done per second in the median, with the spread: "25.1 (23.0 to 26.4)"."""
        fast, slow = self.spread
        return f"{work / self.median:.1f} ({work / slow:.1f} to {work / fast:.1f})"

    def milliseconds(self) -> str:
        """The median in milliseconds, with the spread: "25.1 (23.0 to 26.4)"."""
        fast, slow = self.spread
        return f"{1e3 * self.median:.1f} ({1e3 * fast:.1f} to {1e3 * slow:.1f})"


def time_calls(call: Callable[[], object], repeats: int = 20, warm_up: int = 3) -> Timing:
    """Time `repeats` calls, one by one, after `warm_up` calls that are not counted."""
    for _ in range(warm_up):
        call()
    durations = []
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        durations.append(time.perf_counter() - started)
    return Timing(tuple(durations))
