import numpy as np
import pytest

from deux.bench.timing import Spread, Stopwatch, in_turn, rate, times, times_the_slowest


def test_spread_is_the_median_and_the_tenth_and_ninetieth_percentile() -> None:
    values = np.random.default_rng(0).permutation(np.arange(101.0)).tolist()
    assert Spread.of(values) == Spread(*np.percentile(values, [50, 10, 90]))
    assert Spread.of([3.0]) == Spread(3.0, 3.0, 3.0)


def test_spread_reads_well_at_every_size() -> None:
    assert str(Spread(1234.5, 12.34, 1.234)) == "1234 (12.3 to 1.23)"
    assert str(Spread(0.0123, 0.0, 0.5)) == "0.0123 (0.00 to 0.50)"


def test_measurements_take_turns_in_changing_order() -> None:
    calls: list[str] = []
    found = in_turn({name: lambda name=name: calls.append(name) or len(calls) for name in "abc"}, rounds=2)
    assert "".join(calls) == "abccba"
    assert found == {"a": [1, 6], "b": [2, 5], "c": [3, 4]}


def test_ratios_are_formed_within_each_round() -> None:
    ratios = times_the_slowest({"fast": [20.0, 2.0, 40.0], "slow": [10.0, 1.0, 10.0]})
    assert ratios == {"fast": Spread(2.0, 2.0, 4.0), "slow": Spread(1.0, 1.0, 1.0)}
    assert times_the_slowest({}) == {}
    assert times({"fast": [20.0, 4.0, 40.0], "slow": [10.0, 1.0, 10.0]}, "fast")["slow"] == Spread(0.25, 0.25, 0.5)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    return now


def test_rate_counts_calls_until_the_time_is_over(clock: list[float]) -> None:
    def call() -> None:
        clock[0] += 0.5

    assert rate(call, seconds=3.0) == 2.0
    assert rate(call, seconds=0.0) == 2.0


def test_stopwatch_keeps_the_durations_of_each_part_and_waits_for_the_device(clock: list[float]) -> None:
    def synchronize() -> None:
        clock[0] += 1.0

    watch = Stopwatch(synchronize)
    with watch.measure("outer"):
        watch.start("inner")
        watch.stop("inner")
    assert watch.durations == {"inner": [1.0], "outer": [3.0]}
    assert watch.total("inner") == 1.0
    assert watch.total("nothing") == 0.0


def test_a_timed_function_does_what_it_did_and_keeps_its_attributes(clock: list[float]) -> None:
    class Predictor:
        device = "not an attribute of the instance"

        def __init__(self) -> None:
            self.device = "cpu"

        def __call__(self, number: int, factor: int = 1) -> int:
            clock[0] += 2.0
            return number * factor

    watch = Stopwatch()
    predict = watch.timed("prediction", Predictor())
    assert predict(3, factor=2) == 6
    assert watch.durations == {"prediction": [2.0]}
    assert predict.device == "cpu"  # type: ignore[attr-defined]
