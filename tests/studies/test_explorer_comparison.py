import csv
import io
import math

import pytest
from compared_episodes import episode

from deux.studies.explorer_comparison import ExplorerComparison


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
