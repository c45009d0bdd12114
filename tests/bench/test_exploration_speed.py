from collections.abc import Sequence
from itertools import product
from typing import Any

import pytest

from deux.bench import exploration_speed
from deux.bench.exploration_speed import ExploreSettings, measure_exploration_speed
from deux.bench.timing import Spread
from deux.collection.episodes import EpisodePlan
from deux.collection.perception import MODEL_NEEDS
from deux.contracts import Action, Episode, Explorer, Observation
from deux.errors import DeuxError
from deux.io.progress import Progress
from deux.registry import registry

TINY = ExploreSettings(size=32, robots=1, steps=4, warm_up=2, rounds=1)


@pytest.mark.usefixtures("tiny_models")
def test_every_installed_explorer_is_measured() -> None:
    (table,) = measure_exploration_speed(TINY, None)
    assert [row["explorer"] for row in table.rows] == [
        name for name in registry().names("explorers") if name != "viewpoints"
    ]
    for row in table.rows:
        guided = bool(registry().create("explorers", str(row["explorer"]), {}).needs & MODEL_NEEDS)
        assert row["depth model"] == ("tiny" if guided else "none")
        assert isinstance(row["depth model, %"], Spread)
        assert (row["depth model, %"].low > 0.0) == guided
        assert isinstance(row["steps per second"], Spread)
        assert row["steps per second"].low > 0.0
    for row, part in product(table.rows, ("render", "explorer", "rest")):
        share = row[f"{part}, %"]
        assert isinstance(share, Spread)
        assert 0.0 < share.low <= share.high < 100.0


class Stopping(Explorer):
    def reset(self, episode: Episode) -> None:
        pass

    def act(self, observation: Observation) -> Action:
        return Action.STOP


@pytest.mark.usefixtures("tiny_models")
def test_steps_that_an_explorer_leaves_out_are_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = [0.0]

    def explore(plans: Sequence[EpisodePlan], *given: Any, progress: Progress, **settings: Any) -> None:
        explorer = given[1]()
        for done in range(1, 5):
            seconds[0] += 0.5
            explorer.act(None)
            progress("exploration", done, 10)
        seconds[0] += 7.0
        progress("exploration", 10, 10)  # the collector's report on the steps that were left out

    registry().names("explorers")  # fills the table, so that it comes back afterwards
    monkeypatch.setitem(registry()._plugins, "explorers", [])
    registry().register("explorers", "stopping", Stopping)
    monkeypatch.setattr(exploration_speed, "explore", explore)
    monkeypatch.setattr("time.perf_counter", lambda: seconds[0])
    (table,) = measure_exploration_speed(TINY, None)
    assert table.rows[0]["steps per second"] == Spread(2.0, 2.0, 2.0)


class Lost(Stopping):
    def act(self, observation: Observation) -> Action:
        raise KeyError("compass")


@pytest.mark.usefixtures("tiny_models")
def test_an_explorer_that_fails_is_left_out_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    frontier = next(plugin for plugin in registry().plugins("explorers") if plugin.name == "frontier")
    monkeypatch.setitem(registry()._plugins, "explorers", [frontier])
    registry().register("explorers", "lost", Lost)
    (table,) = measure_exploration_speed(TINY, None)
    assert [row["explorer"] for row in table.rows] == ["frontier"]
    assert any(note.startswith("lost is left out: ") and "compass" in note for note in table.notes)


def test_a_model_that_is_not_installed() -> None:
    with pytest.raises(DeuxError, match="no depth model called 'kbnett'"):
        list(measure_exploration_speed(TINY, "kbnett"))


@pytest.mark.usefixtures("tiny_models")
def test_explorers_that_need_a_model_are_left_out_where_there_is_none() -> None:
    registry().unregister("depth_models", "tiny")
    (table,) = measure_exploration_speed(TINY, None)
    measured = {str(row["explorer"]) for row in table.rows}
    for name in (name for name in registry().names("explorers") if name != "viewpoints"):
        guided = bool(registry().create("explorers", name, {}).needs & MODEL_NEEDS)
        assert (name in measured) != guided
        assert any(note.startswith(f"{name} is left out") for note in table.notes) == guided
