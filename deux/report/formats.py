"""Tables as Markdown, LaTeX and CSV."""

import csv
import io

from deux.report.tables import METRICS, UNITS, Mark, Table, number_text

_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "–": "--",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    **{character: f"\\{character}" for character in "&%$#_{}"},
}


def markdown(table: Table) -> str:
    """A table with its caption and notes; bold and underlined as in the paper."""
    heads = [*table.label_columns, *(f"{group} {metric}".strip() for group in table.groups for metric in METRICS)]
    lines = [f"**{_cell(table.caption)}**", "", _line(map(_cell, heads)), _line([":--"] * len(table.label_columns))]
    lines[-1] = lines[-1].rstrip("|") + "|" + "--:|" * table.columns
    marks = table.marks
    for part, rows in enumerate(table.parts):
        for index, row in enumerate(rows):
            cells = [_cell(label) for label in row.labels]
            for column, number in enumerate(row.numbers):
                mean, behind = number_text(number, table.usual_seeds)
                wrapped = {"best": "**{}**", "second": "<u>{}</u>", None: "{}"}[marks.get((part, index, column))]
                cells.append(wrapped.format(mean) + behind)
            lines.append(_line(cells))
    return "\n".join([*lines, "", *(f"{_cell(note)}  " for note in table.notes)]).rstrip() + "\n"


def latex(table: Table) -> str:
    """A table environment as in the paper; it needs the packages booktabs and graphicx."""
    labels = len(table.label_columns)
    wide = "*" if len(table.groups) > 1 else ""
    lines = [
        "% needs \\usepackage{booktabs,graphicx}",
        f"\\begin{{table{wide}}}[t]",
        "    \\centering",
        f"    \\caption{{{escaped(table.caption)}}}",
        f"    \\label{{{table.name}}}",
        f"    \\resizebox{{{chr(92)}{'text' if wide else 'column'}width}}{{!}}{{%",
        f"    \\begin{{tabular}}{{{'l' * labels}{'r' * table.columns}}}",
        "    \\toprule",
        *_latex_heads(table),
    ]
    marks = table.marks
    for part, rows in enumerate(table.parts):
        lines.append("    \\midrule")
        for index, row in enumerate(rows):
            cells = [escaped(label) for label in row.labels]
            for column, number in enumerate(row.numbers):
                mean, behind = number_text(number, table.usual_seeds, " ± ")
                cells.append(_latex_number(mean, behind, marks.get((part, index, column))))
            lines.append(f"    {' & '.join(cells)} \\\\")
    notes = " ".join(escaped(note) for note in table.notes)
    lines += ["    \\bottomrule", "    \\end{tabular}}", f"    \\\\[2pt]{{\\footnotesize {notes}}}"]
    return "\n".join([*lines, f"\\end{{table{wide}}}", ""])


def csv_text(table: Table) -> str:
    """A line for each row and group of columns, with unrounded numbers."""
    content = io.StringIO()
    writer = csv.writer(content, lineterminator="\n")
    measures = [f"{metric.lower()} [{unit}]" for metric, unit in zip(METRICS, UNITS, strict=True)]
    numbers = [f"{measure} {what}" for measure in measures for what in ("mean", "interval", "mark")]
    writer.writerow([*(name.lower() for name in table.label_columns), "columns", "n", "seeds", *numbers])
    marks = table.marks
    for part, rows in enumerate(table.parts):
        for index, row in enumerate(rows):
            for group, title in enumerate(table.groups):
                first = group * len(METRICS)
                four = row.numbers[first : first + len(METRICS)]
                if four[0] is None:
                    continue
                seeds = four[0].seeds
                line = [*row.labels, title, len(seeds) or "", " ".join(map(str, seeds))]
                for column, number in enumerate(four, first):
                    assert number is not None
                    interval = "" if number.interval is None else repr(number.interval)
                    line += [repr(number.mean), interval, marks.get((part, index, column), "")]
                writer.writerow(line)
    return content.getvalue()


def escaped(text: str) -> str:
    """Text as LaTeX shows it.

    Example:
        >>> escaped("sem_rec 100%")
        'sem\\\\_rec 100\\\\%'
    """
    return "".join(_LATEX.get(character, character) for character in text)


def _latex_heads(table: Table) -> list[str]:
    labels = len(table.label_columns)
    lines = []
    if any(table.groups):
        four = len(METRICS)
        starts = [labels + 1 + four * index for index in range(len(table.groups))]
        titles = [f"\\multicolumn{{{four}}}{{c}}{{{escaped(group)}}}" for group in table.groups]
        lines.append(f"    {' & '.join([*[''] * labels, *titles])} \\\\")
        lines.append("    " + " ".join(f"\\cmidrule(rl){{{start}-{start + four - 1}}}" for start in starts))
    heads = [*map(escaped, table.label_columns), *METRICS * len(table.groups)]
    return [*lines, f"    {' & '.join(heads)} \\\\"]


def _latex_number(mean: str, behind: str, mark: Mark | None) -> str:
    command = {"best": "\\textbf", "second": "\\underline"}.get(mark or "")
    number = f"{command}{{{mean}}}" if command else escaped(mean)
    return f"{number}{{\\scriptsize{escaped(behind)}}}" if behind else number


def _line(cells: object) -> str:
    return f"| {' | '.join(cells)} |"  # type: ignore[arg-type]


def _cell(text: str) -> str:
    """Text that does not end a cell of a Markdown table, nor begins emphasis."""
    return text.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_")
