import csv
import io
import math
import re

import pytest
from markdown_it import MarkdownIt
from rich.console import Console

from deux.metrics.intervals import Estimate
from deux.metrics.tables import Cell, Column, ResultTable, Row, csv_text, error_columns, latex_text


def ranking(*parts: list[list[float | None]], by_part: bool = False, unranked: int | None = None) -> dict:
    """The marks of a table of errors by part, row and column; the row numbered `unranked` is not ranked."""
    number = iter(range(100))
    rows = [
        tuple(
            Row((f"row {n}",), tuple(Cell(None if v is None else Estimate(v, 0.5)) for v in values), n != unranked)
            for values in part
            for n in [next(number)]
        )
        for part in parts
    ]
    table = ResultTable("A caption", ("Exploration",), error_columns(), tuple(rows)).ranked(by_part=by_part)
    return {
        (part, row, column): cell.mark
        for part, rows_of_part in enumerate(table.parts)
        for row, one in enumerate(rows_of_part)
        for column, cell in enumerate(one.cells)
        if cell.mark
    }


def test_the_lowest_is_best_and_the_next_second_column_by_column():
    marks = ranking([[3.0, 1.0, 2.0, 5.0], [2.0, 2.0, 3.0, 4.0]], [[1.0, 3.0, 1.0, 6.0]])
    assert {place for place, mark in marks.items() if mark == "best"} == {(1, 0, 0), (0, 0, 1), (1, 0, 2), (0, 1, 3)}
    assert {place for place, mark in marks.items() if mark == "second"} == {(0, 1, 0), (0, 1, 1), (0, 0, 2), (0, 0, 3)}


def test_ranks_within_parts():
    marks = ranking([[3.0] * 4, [2.0] * 4], [[1.0] * 4, [9.0] * 4], by_part=True)
    assert [marks[part, row, 0] for part in range(2) for row in range(2)] == ["second", "best", "best", "second"]


def test_ties_share_their_rank():
    marks = ranking([[1.0] * 4, [1.0] * 4, [2.0] * 4, [2.0] * 4, [3.0] * 4])
    assert [marks.get((0, row, 0)) for row in range(5)] == ["best", "best", "second", "second", None]


def test_what_is_not_ranked():
    marks = ranking([[0.0] * 4, [3.0, None, math.nan, math.inf], [2.0] * 4], unranked=0)
    assert {place: mark for place, mark in marks.items() if place[2] in (0, 3)} == {
        (0, 2, 0): "best",
        (0, 1, 0): "second",
        (0, 2, 3): "best",
        (0, 1, 3): "second",
    }
    assert not [place for place in marks if place[2] in (1, 2)]  # nobody to be better than


def test_means_over_other_seeds_have_no_rank():
    """Seed 2 is hard: what has not been run with it, or with an easier one in its place, is not the better for that."""
    of_seeds = {(0, 1, 2): (140.0, 135.0), (0,): (98.0,), (0, 1, 3): (113.0,), (): (150.0,)}
    rows = [
        Row((f"{seeds} {mean}",), (Cell(Estimate(mean), seeds=seeds), Cell(Estimate(mean), seeds=seeds)))
        for seeds, means in of_seeds.items()
        for mean in means
    ]
    table = ResultTable("t", ("l",), (Column("MAE", best="lowest"), Column("n")), (tuple(rows),)).ranked()
    assert [row.cells[0].mark for row in table.rows] == ["second", "best", None, None, None]


def test_a_column_marks_which_end_is_best():
    columns = (Column("area", best="highest"), Column("length"))
    rows = tuple(Row((name,), (Cell(Estimate(v)), Cell(Estimate(v)))) for name, v in (("a", 1.0), ("b", 2.0)))
    a, b = ResultTable("Areas", ("who",), columns, (rows,)).ranked(second=False).rows
    assert [cell.mark for cell in (*a.cells, *b.cells)] == [None, None, "best", None]


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        (Cell(), "–"),
        (Cell(Estimate(12.345, 1.25), seeds=(0, 1, 2)), "12.3 ± 1.2"),
        (Cell(Estimate(12.345), seeds=(1,)), "12.3 (seed 1)"),
        (Cell(Estimate(12.345, 3.0), seeds=(1, 2)), "12.3 ± 3.0 (seeds 1, 2)"),
        (Cell(Estimate(12.345, 3.0), seeds=(0, 1, 3)), "12.3 ± 3.0 (seeds 0, 1, 3)"),
        (Cell(Estimate(80.0)), "80.0"),
        (Cell(Estimate(math.nan), seeds=(0, 1, 2)), "nan"),
        (Cell(Estimate(math.inf), seeds=(0, 1, 2)), "inf"),
        (Cell(Estimate(-0.04, 0.0)), "0.0 ± 0.0"),
    ],
)
def test_numbers_as_text(cell, text):
    usual = Row(("a",), (Cell(Estimate(1.0), seeds=(0, 1, 2)),) * 3)
    table = ResultTable("t", ("l",), (Column("MAE"),) * 3, ((usual, Row(("b",), (cell, Cell(), Cell()))),))
    assert "".join(table.cell_text(0, cell)) == text


def test_a_column_has_its_own_digits_and_factor():
    columns = (Column("judged", "%", digits=0, factor=100.0), Column("AUSE", digits=3))
    cells = (Cell(Estimate(0.256, 0.02)), Cell(Estimate(0.2564, 0.02)))
    table = ResultTable("t", ("measure",), columns, ((Row(("l1",), cells),),))
    assert ["".join(table.cell_text(index, cell)) for index, cell in enumerate(cells)] == ["26 ± 2", "0.256 ± 0.020"]
    (line,) = csv.DictReader(io.StringIO(table.csv()))
    assert (line["judged [%] mean"], line["ause interval"]) == ("25.6", "0.02")


def test_the_usual_seeds_are_the_most_frequent():
    often, seldom = Cell(Estimate(1.0), seeds=(0,)), Cell(Estimate(1.0, 1.0), seeds=(0, 1))
    rows = (Row(("a",), (often,) * 4), Row(("b",), (seldom, Cell(), Cell(), Cell())))
    assert ResultTable("c", ("l",), error_columns(), (rows,)).usual_seeds == (0,)


@pytest.fixture
def table() -> ResultTable:
    """Two models by three rows, with names that every format has to escape."""

    def cells(*means: float | None) -> tuple[Cell, ...]:
        return tuple(Cell() if mean is None else Cell(Estimate(mean, 0.25), seeds=(0, 1, 2)) for mean in means)

    baseline = Row(("Interpolation",), tuple(Cell(Estimate(0.5)) for _ in range(8)), ranked=False)
    first = Row(("_sem_rec & 100% {a|b} *",), cells(1, 2, 3, 4, None, None, None, None))
    second = Row(("DEUX",), cells(2, 1, 4, 3, 5, 6, 7, 8))
    return ResultTable(
        caption="On #1_set",
        label_columns=("Exploration",),
        columns=error_columns(),
        parts=((baseline,), (first, second)),
        groups=("KB_Net", "VOICED"),
        name="table1",
        notes=("Mean & interval.", "Lower_is better."),
        units_in_headings=False,
    ).ranked()


def test_the_console_shows_brackets_and_marks(table):
    console = Console(width=250, color_system="standard", force_terminal=True)
    with console.capture() as capture:
        console.print(table)
        console.print(ResultTable("Areas", ("who",), (Column("area", "m²"),), ((Row(("a",), (Cell(),)),),)))
    assert "area [m²]" in capture.get()
    assert "\x1b[1m1.0\x1b[0m ± 0.2" in capture.get()
    assert "\x1b[4m2.0\x1b[0m ± 0.2" in capture.get()
    assert "KB_Net MAE" in capture.get()


def test_markdown(table):
    lines = table.markdown().splitlines()
    assert lines[0] == "**On #1_set**"
    rows = [line for line in lines if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {10}  # nine cells each
    assert rows[0].startswith("| Exploration | KB_Net MAE | KB_Net RMSE |")
    assert rows[2].startswith("| Interpolation | 0.5 |")
    assert rows[3].startswith("| \\_sem_rec & 100% {a\\|b} \\* | **1.0** ± 0.2 | <u>2.0</u> ± 0.2 | **3.0** ± 0.2 |")
    assert rows[3].endswith("| – | – | – | – |")
    assert rows[4].startswith("| DEUX | <u>2.0</u> ± 0.2 | **1.0** ± 0.2 |")
    assert rows[4].endswith("| 8.0 ± 0.2 |")  # alone in its column: nothing to be better than
    assert lines[-1] == "Lower_is better."


def test_latex_is_well_formed(table):
    text = table.latex()
    opened = [name for kind, name in re.findall(r"\\(begin|end)\{(\w+\*?)\}", text) if kind == "begin"]
    closed = [name for kind, name in re.findall(r"\\(begin|end)\{(\w+\*?)\}", text) if kind == "end"]
    assert opened == closed[::-1] == ["table*", "tabular"]
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", text):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0
    body = text[text.index("\\toprule") : text.index("\\bottomrule")]
    rows = [line for line in body.splitlines() if line.endswith("\\\\")]
    separators = [len(re.findall(r"(?<!\\)&", row)) for row in rows]
    assert separators[0] == 2  # the models, each over four columns
    assert separators[1:] == [8] * 4
    assert len(re.findall("[lrc]", re.search(r"begin\{tabular\}\{(\w+)\}", text)[1])) == 9
    assert "\\cmidrule(rl){2-5} \\cmidrule(rl){6-9}" in text
    assert "\\_sem\\_rec \\& 100\\% \\{a|b\\} *" in text
    assert not re.search(r"(?<!\\)[#_]", text.replace("\\label{table1}", ""))
    assert text.isascii()


def test_latex_marks(table):
    text = table.latex()
    assert "\\textbf{1.0}{\\scriptsize $\\pm$ 0.2} & \\underline{2.0}" in text
    assert text.count("\\textbf") == text.count("\\underline") == 4


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a_b", "a\\_b"),
        ("5 %", "5 \\%"),
        ("\\x", "\\textbackslash{}x"),
        ("~^", "\\textasciitilde{}\\textasciicircum{}"),
    ],
)
def test_latex_escapes(text, shown):
    assert latex_text(text) == shown


def test_csv_has_a_line_for_each_group_of_a_row_and_unrounded_numbers(table):
    lines = list(csv.DictReader(io.StringIO(table.csv())))
    assert [(line["exploration"], line["columns"]) for line in lines] == [
        ("Interpolation", "KB_Net"),
        ("Interpolation", "VOICED"),
        ("_sem_rec & 100% {a|b} *", "KB_Net"),
        ("DEUX", "KB_Net"),
        ("DEUX", "VOICED"),
    ]
    deux = lines[3]
    assert (deux["n"], deux["seeds"]) == ("3", "0 1 2")
    assert (float(deux["mae [mm] mean"]), float(deux["mae [mm] interval"])) == (2, 0.25)
    assert (deux["mae [mm] mark"], deux["rmse [mm] mark"]) == ("second", "best")
    assert lines[0]["mae [mm] interval"] == ""


def test_csv_of_a_table_without_groups_and_seeds_has_neither_column():
    row = Row(("a, b",), (Cell(Estimate(1.5, 0.5), "highlighted"), Cell()))
    table = ResultTable("Areas", ("who",), (Column("area", "m²"), Column("objects")), ((row,),))
    header, line = csv.reader(io.StringIO(table.csv()))
    numbers = [f"{heading} {what}" for heading in ("area [m²]", "objects") for what in ("mean", "interval", "mark")]
    assert header == ["who", *numbers]
    assert line == ["a, b", "1.5", "0.5", "highlighted", "", "", ""]
    assert csv_text(["a"], [[None], [0.5]]) == 'a\n""\n0.5\n'


HOSTILE = [
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "[a](javascript:alert(1))",
    "![a](https://example.org/a.png)",
    "[a][b] and [a]: https://example.org",
    "`code` ~~gone~~ **bold** _emphasis_ &lt;b&gt; &#60;b>",
    "a | b \\| c",
    "ends with \\",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_markdown_shows_text_from_outside_as_it_is(text):
    row = Row((text,), (Cell(Estimate(1.0, 0.5)),))
    table = ResultTable("Areas", ("who",), (Column("area", "m²"),), ((row,),), notes=(text,))
    parser = MarkdownIt("gfm-like", {"linkify": False})
    tokens = parser.parse(table.markdown())
    inline = [child for token in tokens for child in token.children or () if token.type == "inline"]
    assert (
        not {token.type for token in inline}
        - {"text", "text_special", "softbreak", "hardbreak"}
        - {
            "strong_open",
            "strong_close",
        }
    )
    cells = [token.content for token in tokens if token.type == "inline" and token.map]
    shown = ["".join(child.content for child in token.children) for token in tokens if token.type == "inline"]
    assert len(cells) == 6  # caption, two headings, two cells, note
    assert shown[3].replace("\\", "") == text.replace("\\", "")
    assert shown[5].replace("\\", "") == text.replace("\\", "")


def test_control_characters_reach_neither_console_nor_markdown():
    row = Row(("a\x1b[31m\nb",), (Cell(Estimate(1.0, 0.5)),))
    table = ResultTable("Areas\x07", ("who",), (Column("area", "m²"),), ((row,),), notes=("n\x1b]0;title\x07",))
    console = Console(width=200, file=io.StringIO(), force_terminal=False)
    console.print(table)
    for text in (console.file.getvalue(), table.markdown(), table.latex()):
        assert not set(text) & {"\x1b", "\x07"}
    assert "a\\x1b[31m b" in console.file.getvalue()


@pytest.mark.parametrize("text", ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "\r=1"])
def test_csv_has_no_formulas(text):
    _, line = csv.reader(io.StringIO(csv_text(["a", "b"], [[text, 1]]), newline=""))
    assert line == ["'" + text.replace("\t", " ").replace("\r", " "), "1"]


@pytest.mark.parametrize("value", [-1.5, "-1.5", "+2e-3", "a=b", None, ""])
def test_csv_keeps_numbers_and_other_text(value):
    (_, line) = csv.reader(io.StringIO(csv_text(["a", "b"], [[value, 1]])))
    assert line[0] == ("" if value is None else str(value))
