import csv
import io
import math

import pytest

from deux.studies.exploration_meter import Exploration
from deux.studies.explorer_comparison import ExplorationEpisode, ExplorerComparison


def episode(explorer: str, scene: str, area: float, number: int = 0, **changes) -> ExplorationEpisode:
    numbers = {"floor_covered": 0.5, "objects_seen": 3, "collisions": 2, "path_length": 1.5}
    rewards = {"growth": area / 10.0}
    exploration = Exploration(**{"area_seen": area, "rewards": rewards, **numbers, **changes})
    return ExplorationEpisode(explorer, scene, number, 7, exploration, [(0.0, 0.0, 0.0)] * 4, 1.0)


@pytest.fixture
def comparison() -> ExplorerComparison:
    """Two scenes that differ more than the two explorers do; two episodes of `still` in the first scene."""
    episodes = [
        episode("still", "small", 9.0),
        episode("still", "small", 11.0, number=1),
        episode("still", "large", 30.0),
        episode("eager", "small", 13.0, collisions=0),
        episode("eager", "large", 33.5, collisions=1),
    ]
    return ExplorerComparison(episodes, {"eager": "growth"})


def test_episodes_of_one_scene_are_averaged_first(comparison):
    assert comparison.sample("still", "area_seen") == {"small": 10.0, "large": 30.0}
    mean, half_width = comparison.estimate("still", "area_seen")
    assert mean == 20.0
    assert half_width == pytest.approx(12.706 * math.sqrt(200.0) / math.sqrt(2), rel=1e-4)  # t of one degree of freedom


def test_gains_are_taken_within_each_scene(comparison):
    mean, half_width = comparison.gain("eager", "still", "area_seen")
    assert mean == pytest.approx(3.25)
    assert half_width == pytest.approx(12.706 * 0.25, rel=1e-4)
    assert comparison.gain("eager", "still", "reward_growth").mean == pytest.approx(0.325)


def test_what_is_not_known_is_left_empty():
    comparison = ExplorerComparison([episode("still", "file", 9.0, objects_seen=None)], {})
    assert comparison.summary()["still"]["objects_seen"] == {"mean": None, "half_width": None}
    (row,) = csv.DictReader(io.StringIO(comparison.table_csv()))
    assert (row["objects_seen"], row["area_seen"], row["area_seen_low"]) == ("", "9.0", "")


def test_csv_has_a_row_for_each_explorer_and_each_episode(comparison):
    rows = list(csv.DictReader(io.StringIO(comparison.table_csv())))
    assert [row["explorer"] for row in rows] == ["still", "eager"]
    assert float(rows[0]["area_seen_high"]) == pytest.approx(20.0 + 127.06, rel=1e-4)
    rows = list(csv.DictReader(io.StringIO(comparison.episodes_csv())))
    assert [(row["scene"], row["episode"]) for row in rows[:3]] == [("small", "0"), ("small", "1"), ("large", "0")]
    assert (rows[3]["frames"], rows[3]["collisions"], rows[3]["reward_growth"]) == ("4", "0", "1.3")
