import csv
import io
import re

import pytest

from deux.report.formats import csv_text, escaped, latex, markdown
from deux.report.summary import Summary
from deux.report.tables import Row, Table


@pytest.fixture
def table() -> Table:
    """Two models by three rows, with names that every format has to escape."""

    def numbers(*means: float | None) -> tuple[Summary | None, ...]:
        return tuple(mean if mean is None else Summary(mean, 0.25, (0, 1, 2)) for mean in means)

    baseline = Row(("Interpolation",), tuple(Summary(0.5, None) for _ in range(8)), ranked=False)
    first = Row(("sem_rec & 100% {a|b} *",), numbers(1, 2, 3, 4, None, None, None, None))
    second = Row(("DEUX",), numbers(2, 1, 4, 3, 5, 6, 7, 8))
    notes = ("Mean & interval.", "Lower_is better.")
    return Table(
        "table1", "On #1_set", ("Exploration",), ("KB_Net", "VOICED"), ((baseline,), (first, second)), notes=notes
    )


def test_markdown(table):
    lines = markdown(table).splitlines()
    assert lines[0] == "**On #1\\_set**"
    rows = [line for line in lines if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {10}  # nine cells each
    assert rows[0].startswith("| Exploration | KB\\_Net MAE | KB\\_Net RMSE |")
    assert rows[2].startswith("| Interpolation | 0.5 |")
    assert rows[3].startswith("| sem\\_rec & 100% {a\\|b} \\* | **1.0** ± 0.2 | <u>2.0</u> ± 0.2 | **3.0** ± 0.2 |")
    assert rows[3].endswith("| – | – | – | – |")
    assert rows[4].startswith("| DEUX | <u>2.0</u> ± 0.2 | **1.0** ± 0.2 |")
    assert rows[4].endswith("| 8.0 ± 0.2 |")  # alone in its column: nothing to be better than
    assert lines[-1] == "Lower\\_is better."


def test_latex_is_well_formed(table):
    text = latex(table)
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
    assert "sem\\_rec \\& 100\\% \\{a|b\\} *" in text
    assert not re.search(r"(?<!\\)[#_]", text.replace("\\label{table1}", ""))
    assert text.isascii()


def test_latex_marks(table):
    text = latex(table)
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
    assert escaped(text) == shown


def test_csv_has_a_line_for_each_cell_and_unrounded_numbers(table):
    lines = list(csv.DictReader(io.StringIO(csv_text(table))))
    assert [(line["exploration"], line["columns"]) for line in lines] == [
        ("Interpolation", "KB_Net"),
        ("Interpolation", "VOICED"),
        ("sem_rec & 100% {a|b} *", "KB_Net"),
        ("DEUX", "KB_Net"),
        ("DEUX", "VOICED"),
    ]
    deux = lines[3]
    assert (deux["n"], deux["seeds"]) == ("3", "0 1 2")
    assert (float(deux["mae [mm] mean"]), float(deux["mae [mm] interval"]), deux["mae [mm] mark"]) == (
        2,
        0.25,
        "second",
    )
    assert deux["rmse [mm] mark"] == "best"
    assert lines[0]["mae [mm] interval"] == ""
