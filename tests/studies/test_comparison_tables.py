import pytest

from deux.metrics.tables import Cell, ResultTable
from deux.studies.comparison_tables import exploration_table, gains_table, rewards_table
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


def texts(table: ResultTable, row: int) -> list[str]:
    return ["".join(table.cell_text(index, cell)) for index, cell in enumerate(table.rows[row].cells)]


def marks(table: ResultTable) -> list[list[str | None]]:
    return [[cell.mark for cell in row.cells] for row in table.rows]


def test_the_best_of_each_column_stands_out(comparison):
    table = exploration_table(comparison)
    assert [row.labels for row in table.rows] == [("still",), ("eager",)]
    assert table.headings[:2] == ("area seen [m²]", "free floor covered [%]")
    assert texts(table, 1)[:2] == ["23.2 ± 130.2", "50.0 ± 0.0"]
    assert marks(table) == [
        [None, "best", "best", None, None],
        ["best", "best", "best", "best", None],  # the fewer collisions; a long path is neither good nor bad
    ]


def test_an_explorers_own_reward_stands_out(comparison):
    table = rewards_table(comparison)
    assert table.headings == ("growth",)
    assert marks(table) == [[None], ["highlighted"]]


def test_a_gain_stands_out_where_its_interval_is_above_zero(comparison):
    table = gains_table(comparison, "still")
    assert [row.labels for row in table.rows] == [("eager",)]
    assert texts(table, 0) == ["3.2 ± 3.2", "0.0 ± 0.0", "0.0 ± 0.0", "0.33 ± 0.32"]  # 3.25 ± 3.18 of area
    assert marks(table) == [["highlighted", None, None, "highlighted"]]
    assert table.headings[-1] == "own reward"


def test_what_is_not_known_is_left_empty():
    comparison = ExplorerComparison([episode("still", "file", 9.0, objects_seen=None)], {})
    assert exploration_table(comparison).rows[0].cells[2] == Cell()
