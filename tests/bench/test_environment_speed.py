import pytest

from deux.bench import environment_speed
from deux.bench.environment_speed import EnvironmentSettings, measure_environment
from deux.bench.timing import Spread
from deux.registry import registry

TINY = EnvironmentSettings(size=16, episode=3, rounds=2, seconds=0.01)


def test_every_installed_reward_is_measured_and_what_else_can_be_seen() -> None:
    (table,) = measure_environment(TINY)
    names = registry().names("rewards")
    assert [row["reward"] for row in table.rows[: len(names)]] == names
    assert {row["observation"] for row in table.rows[: len(names)]} == {"maps"}
    assert [row["observation"] for row in table.rows[len(names) :]] == ["maps, depth", "maps, rgb"]
    for row in table.rows:
        needs = registry().create("rewards", str(row["reward"]), {}).needs
        assert row["labels"] == ("yes" if needs else "no")
        assert isinstance(row["steps per second"], Spread)
        assert isinstance(row["times the slowest"], Spread)
        assert row["steps per second"].low > 0.0


def test_a_reward_that_cannot_be_made_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment_speed, "installed", lambda kind: ({}, ("odd is left out: it is broken.",)))
    (table,) = measure_environment(TINY)
    assert table.rows == ()
    assert table.notes[1:] == ("odd is left out: it is broken.",)
