"""Timing of alternating measurements, with their spread."""

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
    """Repeated measurements of one number.

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
        """Summarise one or more measurements."""
        ordered = sorted(values)
        last = len(ordered) - 1
        return cls(statistics.median(ordered), ordered[round(0.1 * last)], ordered[round(0.9 * last)])

    def __str__(self) -> str:
        return f"{_digits(self.median)} ({_digits(self.low)} to {_digits(self.high)})"


def wait_for_device() -> None:
    """Wait until the graphics card, if this process uses one, has done what it was given."""
    if torch.cuda.is_initialized():
        torch.cuda.synchronize()


class Stopwatch:
    """Durations of the named parts of repeated work, in seconds.

    Args:
        synchronize: waits until a device has done what it was given; called before each reading of the clock.
    """

    def __init__(self, synchronize: Callable[[], object] = wait_for_device) -> None:
        self.durations: dict[str, list[float]] = defaultdict(list)
        self._synchronize = synchronize
        self._started: dict[str, float] = {}

    def start(self, part: str) -> None:
        """Begin a part; forget it if it was begun before."""
        self._started[part] = self._now()

    def stop(self, part: str) -> None:
        """End a part."""
        self.durations[part].append(self._now() - self._started.pop(part))

    @contextmanager
    def measure(self, part: str) -> Iterator[None]:
        """Time the body of a `with` statement."""
        self.start(part)
        yield
        self.stop(part)

    def timed(self, part: str, call: Callable[P, T]) -> Callable[P, T]:
        """`call` with every call of it timed. The function that is returned has the attributes of `call`, too."""

        @wraps(call)
        def timed(*args: P.args, **kwargs: P.kwargs) -> T:
            with self.measure(part):
                return call(*args, **kwargs)

        return timed

    def total(self, part: str) -> float:
        """Seconds of all durations of a part."""
        return sum(self.durations[part])

    def _now(self) -> float:
        self._synchronize()
        return time.perf_counter()


def rate(call: Callable[[], object], seconds: float) -> float:
    """Calls a second, of as many as fit into a time; at least one."""
    started, count, elapsed = time.perf_counter(), 0, 0.0
    while elapsed < seconds or count == 0:
        call()
        count += 1
        elapsed = time.perf_counter() - started
    return count / elapsed


def in_turn(measurements: Mapping[K, Callable[[], T]], rounds: int) -> dict[K, list[T]]:
    """Take every measurement once a round, every other round in the opposite order.

    What changes while a benchmark runs, such as the load of the machine, then meets all of them alike, and their ratios
    hold even where the numbers do not.
    """
    results: dict[K, list[T]] = {name: [] for name in measurements}
    for number in range(rounds):
        for name in list(measurements)[:: -1 if number % 2 else 1]:
            results[name].append(measurements[name]())
    return results


def times_the_slowest(rates: Mapping[K, Sequence[float]]) -> dict[K, Spread]:
    """Ratio of each rate to that of the slowest, formed within each round."""
    if not rates:
        return {}
    return times(rates, min(rates, key=lambda name: statistics.median(rates[name])))


def times(rates: Mapping[K, Sequence[float]], reference: K) -> dict[K, Spread]:
    """Ratio of each rate to that of `reference`, formed within each round."""
    return {
        name: Spread.of([own / other for own, other in zip(values, rates[reference], strict=True)])
        for name, values in rates.items()
    }


def _digits(value: float) -> str:
    """About three significant digits, without an exponent."""
    size = abs(value)
    return f"{value:.{0 if size >= 100 else 1 if size >= 10 else 2 if size >= 0.1 or size == 0 else 4}f}"
