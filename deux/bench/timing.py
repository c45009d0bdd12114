"""Stopwatch, alternating measurements and their statistics."""

import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import ParamSpec, TypeVar

import torch

P = ParamSpec("P")
T = TypeVar("T")
K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class Spread:
    """Median and percentiles of repeated measurements.

    Args:
        median: the median.
        low: the 10th percentile.
        high: the 90th percentile.
    """

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Compute the statistics of one or more measurements."""
        ordered = sorted(values)
        last = len(ordered) - 1
        return cls(statistics.median(ordered), ordered[round(0.1 * last)], ordered[round(0.9 * last)])

    def __str__(self) -> str:
        return f"{_digits(self.median)} ({_digits(self.low)} to {_digits(self.high)})"


def wait_for_device() -> None:
    """Wait until the GPU has completed all operations, if this process uses one."""
    if torch.cuda.is_initialized():
        torch.cuda.synchronize()


class Stopwatch:
    """Measures the durations of named parts of repeated work, in seconds.

    Args:
        synchronize: function that waits until a device has completed all operations; called before each reading of the
            clock.
    """

    def __init__(self, synchronize: Callable[[], object] = wait_for_device) -> None:
        self.durations: dict[str, list[float]] = defaultdict(list)
        self._synchronize = synchronize
        self._started: dict[str, float] = {}

    def start(self, part: str) -> None:
        """Start a part, or restart it if it has been started and not stopped."""
        self._started[part] = self._now()

    def stop(self, part: str) -> None:
        """Stop a part and record its duration."""
        self.durations[part].append(self._now() - self._started.pop(part))

    @contextmanager
    def measure(self, part: str) -> Iterator[None]:
        """Measure the body of a `with` statement as a part."""
        self.start(part)
        yield
        self.stop(part)

    def timed(self, part: str, call: Callable[P, T]) -> Callable[P, T]:
        """Wrap a function so that each call is measured as a part; the wrapper keeps the attributes of `call`."""

        @wraps(call)
        def timed(*args: P.args, **kwargs: P.kwargs) -> T:
            with self.measure(part):
                return call(*args, **kwargs)

        return timed

    def total(self, part: str) -> float:
        """Sum of all durations of a part in seconds."""
        return sum(self.durations[part])

    def _now(self) -> float:
        self._synchronize()
        return time.perf_counter()


def rate(call: Callable[[], object], seconds: float) -> float:
    """Call a function repeatedly, at least once, until `seconds` have passed, and return the calls per second."""
    started, count, elapsed = time.perf_counter(), 0, 0.0
    while elapsed < seconds or count == 0:
        call()
        count += 1
        elapsed = time.perf_counter() - started
    return count / elapsed


def in_turn(measurements: Mapping[K, Callable[[], T]], rounds: int) -> dict[K, list[T]]:
    """Take every measurement once per round, in reversed order in every second round.

    Changes during the benchmark, for example of the machine's load, thus affect all measurements alike, and ratios
    within a round remain valid.

    Args:
        measurements: functions that take one measurement, by name.
        rounds: number of rounds.

    Returns:
        The results of all rounds, by name.
    """
    results: dict[K, list[T]] = {name: [] for name in measurements}
    for number in range(rounds):
        for name in list(measurements)[:: -1 if number % 2 else 1]:
            results[name].append(measurements[name]())
    return results


def times_the_slowest(rates: Mapping[K, Sequence[float]]) -> dict[K, Spread]:
    """Ratios of all rates to the one with the lowest median, computed within each round."""
    if not rates:
        return {}
    return times(rates, min(rates, key=lambda name: statistics.median(rates[name])))


def times(rates: Mapping[K, Sequence[float]], reference: K) -> dict[K, Spread]:
    """Ratios of all rates to that of `reference`, computed within each round."""
    return {
        name: Spread.of([own / other for own, other in zip(values, rates[reference], strict=True)])
        for name, values in rates.items()
    }


def _digits(value: float) -> str:
    """Format a number with about three significant digits and without an exponent."""
    size = abs(value)
    return f"{value:.{0 if size >= 100 else 1 if size >= 10 else 2 if size >= 0.1 or size == 0 else 4}f}"
