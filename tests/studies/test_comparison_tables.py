from compared_episodes import episode

from deux.metrics.tables import Cell, ResultTable
from deux.studies.comparison_tables import exploration_table, gains_table, rewards_table
from deux.studies.explorer_comparison import ExplorerComparison


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
        [None, "best", "best", None, None, None, None],
        ["best", "best", "best", "best", None, None, None],  # how it walked is neither good nor bad
    ]
    assert table.headings[-3:] == ("way walked [m]", "forward share [%]", "frames with parallax [%]")
    assert texts(table, 1)[-3:] == ["1.5 ± 0.0", "25.0 ± 0.0", "50.0 ± 0.0"]


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
