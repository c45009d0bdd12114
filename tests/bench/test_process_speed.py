"""The table of processes: who is measured where, over the same steps."""

import json
from collections.abc import Sequence
from typing import Any

import pytest

from deux.bench import process_speed
from deux.bench.process_speed import ProcessSettings, measure_processes
from deux.bench.timing import Spread
from deux.collection.executors import make_executor
from deux.collection.jobs import Job, run_here
from deux.collection.perception import MODEL_NEEDS
from deux.errors import DeuxError
from deux.registry import registry

TINY = ProcessSettings(size=32, robots=2, steps=6, rounds=1)
RATES = ("steps per second, whole", "steps per second, steady")


@pytest.fixture
def no_ray(monkeypatch: pytest.MonkeyPatch) -> None:
    def make(name: str, *given: Any) -> Any:
        if name == "ray":
            raise DeuxError("collect.executor=ray cannot import Ray.")
        return make_executor(name, *given)

    monkeypatch.setattr(process_speed, "make_executor", make)


@pytest.mark.slow
@pytest.mark.usefixtures("tiny_models", "no_ray")
def test_one_process_and_two_are_compared_with_a_model_and_without(
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.syspath_prepend(str(request.config.rootpath))  # where other processes find the tiny model
    (table,) = measure_processes(TINY, None)
    assert [row["where"] for row in table.rows] == ["one process", "2 processes"] * 2
    assert [row["depth model"] for row in table.rows] == ["tiny", "tiny", "none", "none"]
    for row in table.rows:
        needs = registry().create("explorers", str(row["explorer"]), {}).needs
        assert bool(needs & MODEL_NEEDS) == (row["depth model"] == "tiny")
        for rate in RATES:
            assert isinstance(row[rate], Spread)
            assert row[rate].low > 0.0
    assert [row["times one process"] == Spread(1.0, 1.0, 1.0) for row in table.rows] == [True, False] * 2
    assert table.notes[-1] == "Ray is left out: collect.executor=ray cannot import Ray."


@pytest.mark.usefixtures("tiny_models")
def test_all_take_the_same_steps_and_all_steps_count(monkeypatch: pytest.MonkeyPatch) -> None:
    records: dict[str, list[Any]] = {"one": [], "two": []}
    batches: list[int] = []

    def executor(name: str) -> Any:
        def execute(run: Any, jobs: Sequence[Job[Any]], count: Any) -> None:
            batches.extend(len(job.plans) for job in jobs)
            run_here(run, jobs, count)
            plans = [plan for job in jobs for plan in job.plans]
            records[name].append([json.loads(plan.record.read_bytes()) for plan in plans])

        return execute

    ways = {process_speed._ONE: executor("one"), "two": executor("two")}
    monkeypatch.setattr(process_speed, "_executors", lambda: (ways, ()))
    (table,) = measure_processes(ProcessSettings(size=32, robots=2, steps=6, rounds=2), "tiny")
    warm_up = 2
    assert len(table.rows) == 4
    assert sorted(map(str, records["one"][warm_up:])) == sorted(map(str, records["two"]))
    assert len({str(round_) for round_ in records["two"]}) == 4  # two rounds of two explorers, each with its seeds
    assert set(batches) == {1, 2}


def test_the_steady_rate_is_that_after_a_third() -> None:
    told = [(2, 1.0), (4, 11.0), (8, 12.0), (12, 13.0)]
    assert process_speed._steady_rate(told, 12) == pytest.approx(8 / 2.0)
    # The second episode stopped after four of its six steps: the rest is reported at the end.
    assert process_speed._steady_rate([(4, 1.0), (10, 3.0), (12, 9.0)], 10) == pytest.approx(6 / 2.0)


@pytest.mark.usefixtures("tiny_models", "no_ray")
def test_no_model_leaves_the_guided_explorer_out(monkeypatch: pytest.MonkeyPatch) -> None:
    registry().unregister("depth_models", "tiny")
    ways = {process_speed._ONE: make_executor("local", {})}
    monkeypatch.setattr(process_speed, "_executors", lambda: (ways, ()))
    (table,) = measure_processes(TINY, None)
    assert [row["depth model"] for row in table.rows] == ["none"]
    assert any("is left out: no depth model is installed." in note for note in table.notes)
    with pytest.raises(DeuxError, match="no depth model called 'kbnett'"):
        list(measure_processes(TINY, "kbnett"))


def test_ray_is_measured_where_it_is_installed() -> None:
    pytest.importorskip("ray", reason="Ray is not installed: pip install -e '.[ray]'")
    executors, notes = process_speed._executors()
    assert list(executors) == ["one process", "2 processes", "Ray, 2 workers"]
    assert executors["Ray, 2 workers"].workers == 2  # type: ignore[attr-defined]
    assert notes == ()
