from itertools import product

import pytest

from deux.bench.exploration_speed import ExploreSettings, measure_exploration
from deux.bench.timing import Spread
from deux.collection.perception import MODEL_NEEDS
from deux.errors import DeuxError
from deux.registry import registry

TINY = ExploreSettings(size=32, robots=2, steps=6, warm_up=3, rounds=2)


@pytest.mark.usefixtures("tiny_models")
def test_every_installed_explorer_is_measured() -> None:
    (table,) = measure_exploration(TINY, None)
    assert [row["explorer"] for row in table.rows] == registry().names("explorers")
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


def test_a_model_that_is_not_installed() -> None:
    with pytest.raises(DeuxError, match="no depth model called 'kbnett'"):
        list(measure_exploration(TINY, "kbnett"))


@pytest.mark.usefixtures("tiny_models")
def test_explorers_that_need_a_model_are_left_out_where_there_is_none() -> None:
    registry().unregister("depth_models", "tiny")
    (table,) = measure_exploration(TINY, None)
    measured = {str(row["explorer"]) for row in table.rows}
    for name in registry().names("explorers"):
        guided = bool(registry().create("explorers", name, {}).needs & MODEL_NEEDS)
        assert (name in measured) != guided
        assert any(note.startswith(f"{name} is left out") for note in table.notes) == guided
