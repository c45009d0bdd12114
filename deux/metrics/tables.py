"""Tables of means with confidence intervals, for the console and as Markdown, LaTeX and CSV."""

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from rich.markup import escape
from rich.table import Table

from deux.errors import plural, printable
from deux.metrics.depth_errors import METRICS
from deux.metrics.intervals import Estimate

NO_VALUE = "–"
"""Text of a cell without a number."""

Mark = Literal["best", "second", "highlighted"]
"""Emphasis of a number: best and highlighted numbers are bold, the second best is underlined."""

_MARKDOWN: dict[Mark | None, str] = {"best": "**{}**", "highlighted": "**{}**", "second": "<u>{}</u>", None: "{}"}
_LATEX: dict[Mark | None, str] = {
    "best": "\\textbf{{{}}}",
    "highlighted": "\\textbf{{{}}}",
    "second": "\\underline{{{}}}",
    None: "{}",
}
_RICH: dict[Mark | None, str] = {
    "best": "[bold]{}[/]",
    "highlighted": "[bold]{}[/]",
    "second": "[underline]{}[/]",
    None: "{}",
}

_NUMBER = re.compile(r"[+-]?[\d.]+(e[+-]?\d+)?")

_LATEX_CHARACTERS = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "–": "--",
    "²": r"\textsuperscript{2}",
    "ρ": r"$\rho$",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    **{character: f"\\{character}" for character in "&%$#_{}"},
}


@dataclass(frozen=True)
class Column:
    """A column of numbers.

    Args:
        title: title of the column.
        unit: unit of the displayed numbers; empty for none.
        digits: number of decimals.
        factor: factor from stored to displayed numbers, for example 100 for fractions in per cent.
        best: whether the lowest or highest number is best, for `ResultTable.ranked`; None for no ranking.
    """

    title: str
    unit: str = ""
    digits: int = 1
    factor: float = 1.0
    best: Literal["lowest", "highest"] | None = None

    @property
    def heading(self) -> str:
        """The title with the unit: "MAE [mm]"."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True)
class Cell:
    """A number of a table.

    Args:
        estimate: the mean and its interval; None for an empty cell.
        mark: emphasis of the number.
        seeds: random seeds over which the mean is computed; empty for a number that does not depend on a seed.
        digits: number of decimals; None for that of the column.
    """

    estimate: Estimate | None = None
    mark: Mark | None = None
    seeds: tuple[int, ...] = ()
    digits: int | None = None


@dataclass(frozen=True)
class Row:
    """A row of a table.

    Args:
        labels: text of the label columns.
        cells: the numbers, one for each column of each group.
        ranked: whether the row is included in the ranking.
    """

    labels: tuple[str, ...]
    cells: tuple[Cell, ...]
    ranked: bool = True


@dataclass(frozen=True)
class ResultTable:
    """A table of means with their 95 % intervals, which rich can print on the console.

    Args:
        caption: caption without a full stop.
        label_columns: headings of the label columns.
        columns: the columns of numbers.
        parts: the rows, in parts that are separated by a line.
        groups: headings of column groups, each of which repeats all columns; ("",) for no groups.
        name: name of its files and its LaTeX label, for example "table1".
        notes: footnotes, one sentence each.
        units_in_headings: whether the headings include the units; otherwise the notes should.
    """

    caption: str
    label_columns: tuple[str, ...]
    columns: tuple[Column, ...]
    parts: tuple[tuple[Row, ...], ...]
    groups: tuple[str, ...] = ("",)
    name: str = "table"
    notes: tuple[str, ...] = ()
    units_in_headings: bool = True

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows of all parts."""
        return tuple(row for part in self.parts for row in part)

    @property
    def headings(self) -> tuple[str, ...]:
        """The headings of one group's columns."""
        return tuple(column.heading if self.units_in_headings else column.title for column in self.columns)

    @property
    def usual_seeds(self) -> tuple[int, ...]:
        """The most frequent set of seeds; numbers with other seeds show these and are not ranked."""
        found = Counter(cell.seeds for row in self.rows for cell in row.cells if cell.seeds)
        return max(found, key=lambda seeds: (found[seeds], len(seeds))) if found else ()

    def ranked(self, by_part: bool = False, second: bool = True) -> "ResultTable":
        """The table with the best and second best number of each column marked; equal numbers share a rank.

        Means over other seeds than `usual_seeds` are not ranked, since seeds may differ in the scenes they use.

        Args:
            by_part: whether each part is ranked separately.
            second: whether the second best is marked.
        """
        if not by_part:
            ranked = iter(self._ranked(self.rows, second))
            return replace(self, parts=tuple(tuple(next(ranked) for _ in part) for part in self.parts))
        return replace(self, parts=tuple(self._ranked(part, second) for part in self.parts))

    def cell_text(self, index: int, cell: Cell) -> tuple[str, str]:
        """A number as text: its mean, and a suffix such as " ± 0.5 (seeds 0, 1)", which may be empty.

        Args:
            index: index of the cell in its row.
            cell: the cell.
        """
        if cell.estimate is None:
            return NO_VALUE, ""
        column = self.columns[index % len(self.columns)]
        digits = column.digits if cell.digits is None else cell.digits
        mean, half_width = (f"{number * column.factor:z.{digits}f}" for number in cell.estimate)  # z: no "-0.0"
        suffix = "" if math.isnan(cell.estimate.half_width) else f" ± {half_width}"
        if cell.seeds not in ((), self.usual_seeds):
            suffix += f" ({plural('seed', len(cell.seeds))} {', '.join(map(str, cell.seeds))})"
        return mean, suffix

    def rich(self) -> Table:
        """The table as a rich table."""
        table = Table(title=_console_text(self.caption), caption="\n".join(map(_console_text, self.notes)) or None)
        for label in self.label_columns:
            table.add_column(_console_text(label), no_wrap=True)
        for heading in self._full_headings():
            table.add_column(_console_text(heading), justify="right")
        for part in self.parts:
            for row in part:
                table.add_row(*map(_console_text, row.labels), *self._cells(row, _RICH, escape))
            table.add_section()
        return table

    def __rich__(self) -> Table:
        return self.rich()

    def markdown(self) -> str:
        """The caption in bold, the table and the notes as Markdown."""
        headings = [*map(markdown_text, self.label_columns), *map(markdown_text, self._full_headings())]
        rule = [":--"] * len(self.label_columns) + ["--:"] * (len(self.columns) * len(self.groups))
        rows = [[*map(markdown_text, row.labels), *self._cells(row, _MARKDOWN, markdown_text)] for row in self.rows]
        lines = [f"| {' | '.join(cells)} |" for cells in (headings, rule, *rows)]
        notes = ["", *(f"{markdown_text(note)}  " for note in self.notes)]
        return "\n".join([f"**{markdown_text(self.caption)}**", "", *lines, *notes]).rstrip() + "\n"

    def latex(self) -> str:
        """The table as a LaTeX environment, which needs the packages booktabs and graphicx."""
        wide = "*" if len(self.groups) > 1 else ""
        columns = "l" * len(self.label_columns) + "r" * (len(self.columns) * len(self.groups))
        lines = [
            "% needs \\usepackage{booktabs,graphicx}",
            f"\\begin{{table{wide}}}[t]",
            "    \\centering",
            f"    \\caption{{{latex_text(self.caption)}}}",
            f"    \\label{{{self.name}}}",
            f"    \\resizebox{{\\{'text' if wide else 'column'}width}}{{!}}{{%",
            f"    \\begin{{tabular}}{{{columns}}}",
            "    \\toprule",
            *self._latex_headings(),
        ]
        for part in self.parts:
            lines.append("    \\midrule")
            for row in part:
                cells = [*map(latex_text, row.labels), *self._cells(row, _LATEX, latex_text, "{{\\scriptsize{}}}")]
                lines.append(f"    {' & '.join(cells)} \\\\")
        lines += ["    \\bottomrule", "    \\end{tabular}}"]
        if self.notes:
            lines.append(f"    \\\\[2pt]{{\\footnotesize {' '.join(map(latex_text, self.notes))}}}")
        return "\n".join([*lines, f"\\end{{table{wide}}}", ""])

    def csv(self) -> str:
        """CSV with a line for each row and group: unrounded means, half widths of the intervals, and marks."""
        grouped, seeded = any(self.groups), bool(self.usual_seeds)
        labels = [*(label.lower() for label in self.label_columns), *(["columns"] if grouped else [])]
        labels += ["n", "seeds"] if seeded else []
        numbers = [f"{c.title.lower()}{f' [{c.unit}]' if c.unit else ''}" for c in self.columns]
        header = [*labels, *(f"{number} {what}" for number in numbers for what in ("mean", "interval", "mark"))]
        lines = []
        for row in self.rows:
            for group, cells in zip(self.groups, self._by_group(row), strict=True):
                if all(cell.estimate is None for cell in cells):
                    continue
                seeds = cells[0].seeds
                line: list[Any] = [*row.labels, *([group] if grouped else [])]
                line += [len(seeds) or None, " ".join(map(str, seeds))] if seeded else []
                for column, cell in zip(self.columns, cells, strict=True):
                    line += [*_scaled(cell.estimate, column.factor), cell.mark]
                lines.append(line)
        return csv_text(header, lines)

    def _ranked(self, rows: Sequence[Row], second: bool) -> tuple[Row, ...]:
        cells, comparable = [list(row.cells) for row in rows], ((), self.usual_seeds)
        for index in range(len(self.columns) * len(self.groups)):
            best = self.columns[index % len(self.columns)].best
            means = {
                number: row.cells[index].estimate.mean  # type: ignore[union-attr]
                for number, row in enumerate(rows)
                if best and row.ranked and row.cells[index].seeds in comparable and row.cells[index].estimate
            }
            means = {number: mean for number, mean in means.items() if not math.isnan(mean)}
            if len(means) < 2:  # nothing to compare
                continue
            marks: tuple[Mark, ...] = ("best", "second") if second else ("best",)
            order = dict(zip(sorted(set(means.values()), reverse=best == "highest"), marks, strict=False))
            for number, mean in means.items():
                cells[number][index] = replace(cells[number][index], mark=order.get(mean))
        return tuple(replace(row, cells=tuple(new)) for row, new in zip(rows, cells, strict=True))

    def _by_group(self, row: Row) -> Iterator[tuple[Cell, ...]]:
        for start in range(0, len(row.cells), len(self.columns)):
            yield row.cells[start : start + len(self.columns)]

    def _full_headings(self) -> list[str]:
        return [f"{group} {heading}".strip() for group in self.groups for heading in self.headings]

    def _cells(
        self, row: Row, marks: Mapping[Mark | None, str], escaped: Callable[[str], str], small: str = "{}"
    ) -> Iterator[str]:
        """The numbers of a row as text of one format."""
        for index, cell in enumerate(row.cells):
            mean, suffix = self.cell_text(index, cell)
            number = marks[cell.mark].format(escaped(mean))
            yield number + (small.format(escaped(suffix)) if suffix else "")

    def _latex_headings(self) -> list[str]:
        labels, width = len(self.label_columns), len(self.columns)
        lines = []
        if any(self.groups):
            starts = [labels + 1 + width * index for index in range(len(self.groups))]
            titles = [f"\\multicolumn{{{width}}}{{c}}{{{latex_text(group)}}}" for group in self.groups]
            lines.append(f"    {' & '.join([*[''] * labels, *titles])} \\\\")
            lines.append("    " + " ".join(f"\\cmidrule(rl){{{start}-{start + width - 1}}}" for start in starts))
        headings = map(latex_text, [*self.label_columns, *self.headings * len(self.groups)])
        return [*lines, f"    {' & '.join(headings)} \\\\"]


def error_columns() -> tuple[Column, ...]:
    """The columns of the four depth error metrics."""
    return tuple(Column(metric.title, metric.unit, best="lowest") for metric in METRICS.values())


def csv_text(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Format values as CSV; None becomes an empty field.

    Text that a spreadsheet would interpret as a formula, such as a name that begins with "=", is prefixed with an
    apostrophe.

    Example:
        >>> csv_text(["scene", "area"], [["a", 1.5], ["=b", None]])
        "scene,area\\na,1.5\\n'=b,\\n"
    """
    content = io.StringIO()
    writer = csv.writer(content, lineterminator="\n")
    writer.writerows([_no_formula(value) for value in row] for row in (header, *rows))
    return content.getvalue()


def latex_text(text: str) -> str:
    """Escape text for LaTeX.

    Example:
        >>> latex_text("sem_rec 100%")
        'sem\\\\_rec 100\\\\%'
    """
    return "".join(_LATEX_CHARACTERS.get(character, character) for character in printable(text))


def _scaled(estimate: Estimate | None, factor: float) -> tuple[float | None, float | None]:
    """Scaled mean and half width, None where there is none."""
    if estimate is None:
        return None, None
    return estimate.mean * factor, None if math.isnan(estimate.half_width) else estimate.half_width * factor


def markdown_text(text: str) -> str:
    """Escape text for Markdown: emphasis, code, HTML, links and table cells.

    Example:
        >>> markdown_text("sem_rec *"), markdown_text("<b>"), markdown_text("[a](b)")
        ('sem_rec \\\\*', '&lt;b>', '[a\\\\](b)')
    """
    text = re.sub(r"&(?=#|\w)", "&amp;", printable(text)).replace("<", "&lt;")
    return re.sub(r"[|*`\\]|~(?=~)|\](?=[(\[:])|(?<![^\W_])_|_(?![^\W_])", r"\\\g<0>", text)


def _no_formula(value: Any) -> Any:
    """The value with an apostrophe in front if a spreadsheet would interpret it as a formula."""
    if not isinstance(value, str):
        return value
    begins = value.startswith(("=", "+", "-", "@", "\t", "\r")) and not _NUMBER.fullmatch(value)
    return f"'{printable(value)}" if begins else printable(value)  # a carriage return would begin a new line


def _console_text(text: str) -> str:
    return escape(printable(text))
