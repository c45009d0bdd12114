import math

import pytest

from deux.report.summary import Summary
from deux.report.tables import Row, Table, number_text


def table(*parts: list[list[float | None]], ranked_by_part: bool = False, unranked: int | None = None) -> Table:
    """A table of four columns; the row numbered `unranked` takes no part in the ranking."""
    number = iter(range(100))
    rows = [
        tuple(
            Row((f"row {n}",), tuple(v if v is None else Summary(v, 0.5, (0, 1)) for v in values), n != unranked)
            for values in part
            for n in [next(number)]
        )
        for part in parts
    ]
    return Table("table1", "A caption", ("Exploration",), ("",), tuple(rows), ranked_by_part)


def test_the_lowest_is_best_and_the_next_second_column_by_column():
    marks = table([[3.0, 1.0, 2.0, 5.0], [2.0, 2.0, 3.0, 4.0]], [[1.0, 3.0, 1.0, 6.0]]).marks
    assert {place for place, mark in marks.items() if mark == "best"} == {(1, 0, 0), (0, 0, 1), (1, 0, 2), (0, 1, 3)}
    assert {place for place, mark in marks.items() if mark == "second"} == {(0, 1, 0), (0, 1, 1), (0, 0, 2), (0, 0, 3)}


def test_ranks_within_parts():
    marks = table([[3.0] * 4, [2.0] * 4], [[1.0] * 4, [9.0] * 4], ranked_by_part=True).marks
    assert [marks[part, row, 0] for part in range(2) for row in range(2)] == ["second", "best", "best", "second"]


def test_ties_share_their_rank():
    marks = table([[1.0] * 4, [1.0] * 4, [2.0] * 4, [2.0] * 4, [3.0] * 4]).marks
    assert [marks.get((0, row, 0)) for row in range(5)] == ["best", "best", "second", "second", None]


def test_what_is_not_ranked():
    marks = table([[0.0] * 4, [3.0, None, math.nan, 3.0], [2.0] * 4], unranked=0).marks
    assert {place: mark for place, mark in marks.items() if place[2] in (0, 3)} == {
        (0, 2, 0): "best",
        (0, 1, 0): "second",
        (0, 2, 3): "best",
        (0, 1, 3): "second",
    }
    assert not [place for place in marks if place[2] in (1, 2)]  # nobody to be better than


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (None, "–"),
        (Summary(12.345, 1.25, (0, 1, 2)), "12.3 ± 1.2"),
        (Summary(12.345, None, (1,)), "12.3 (n=1)"),
        (Summary(12.345, 3.0, (1, 2)), "12.3 ± 3.0 (n=2)"),
        (Summary(80.0, None), "80.0"),
        (Summary(math.nan, math.nan, (0, 1, 2)), "nan ± nan"),
    ],
)
def test_numbers_as_text(number, text):
    assert "".join(number_text(number, (0, 1, 2))) == text


def test_the_usual_seeds_are_the_most_frequent():
    rows = [Row(("a",), (Summary(1.0, None, (0,)),) * 4), Row(("b",), (Summary(1.0, 1.0, (0, 1)), None, None, None))]
    assert Table("t", "c", ("l",), ("",), (tuple(rows),)).usual_seeds == (0,)
