"""The report as a self-contained HTML page."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from deux.errors import counted
from deux.metrics.tables import Mark, ResultTable
from deux.report.conditions import FlatOptions
from deux.report.contents import Contents, Section
from deux.report.report_figures import CaptionedFigure

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 78rem; padding: 0 1rem; color: #1c1e21; }
h2 { margin-top: 2.5rem; border-bottom: 1px solid #d5d8dc; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .55rem; white-space: nowrap; text-align: right; }
th.label { text-align: left; font-weight: normal; }
thead th { border-bottom: 1px solid #1c1e21; }
thead th.group { text-align: center; }
tbody { border-bottom: 1px solid #9aa0a6; }
.suffix { color: #6a6f75; font-size: 11px; }
.note { color: #4a4f55; font-size: 13px; margin: .1rem 0; }
.missing { background: #fff6e0; padding: .5rem 1rem; }
img { max-width: 100%; }
figure { margin: 1.2rem 0; }
pre { background: #f3f4f6; padding: .6rem; white-space: pre-wrap; overflow-wrap: anywhere; font-size: 12px; }
""".strip()

_MARKS: dict[Mark | None, str] = {"best": "<b>{}</b>", "highlighted": "<b>{}</b>", "second": "<u>{}</u>", None: "{}"}
_MIME = {".png": "image/png", ".jpg": "image/jpeg"}


def html_page(contents: Contents, figures: Mapping[str, Sequence[CaptionedFigure]]) -> str:
    """Render the report as an HTML page with embedded figures.

    Args:
        contents: contents of the report.
        figures: figures by the name of their table.
    """
    further = (
        ("corrected", "Corrected depth", contents.corrected),
        ("scorecards", "Scorecards", contents.scorecards),
    )
    body = [
        "<h1>Report</h1>",
        _paragraph(f"{contents.state}, below {contents.folder}."),
        "<ul>",
        *(f'<li><a href="#{s.table.name}">{escape(s.title)}</a>: {s.state}</li>' for s in contents.sections),
        *(f'<li><a href="#{anchor}">{title}</a></li>' for anchor, title, tables in further if tables),
        "</ul>",
        *(_paragraph(note, "note") for note in contents.notes),
    ]
    for section in contents.sections:
        body += _section(section, figures.get(section.table.name, ()))
    for anchor, title, tables in further:
        body += _further_tables(anchor, title, tables)
    head = f'<meta charset="utf-8"><title>Report: {escape(contents.state)}</title><style>{_STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head>\n<body>\n' + "\n".join(body) + "\n</body></html>\n"


def _section(section: Section, figures: Iterable[CaptionedFigure]) -> list[str]:
    lines = [f'<h2 id="{section.table.name}">{escape(section.title)}</h2>', *_table(section.table)]
    if section.missing:
        missing = "".join(f"<li>{escape(line)}</li>" for line in section.missing)
        lines.append(
            f'<div class="missing"><b>Missing: {counted(len(section.runs.missing), "run")}</b><ul>{missing}</ul></div>'
        )
    for figure in figures:
        content = base64.b64encode(figure.file.read_bytes()).decode()
        source = f"data:{_MIME[figure.file.suffix]};base64,{content}"
        caption = escape(figure.caption)
        lines.append(f'<figure><img src="{source}" alt="{caption}"><figcaption>{caption}</figcaption></figure>')
    lines.append("<h3>Commands</h3>")
    lines += [f"<pre>{escape(command)}</pre>" for command in section.commands]
    lines.append("<details><summary>Training and test frames</summary>")
    lines += _options("trained", section.runs.training) + _options("tested", section.runs.testing)
    return [*lines, "</details>"]


def _further_tables(anchor: str, title: str, tables: Sequence[ResultTable]) -> list[str]:
    """A section of tables below those of the runs; empty without tables."""
    lines = [f'<h2 id="{anchor}">{title}</h2>'] if tables else []
    for table in tables:
        lines += [f"<h3>{escape(table.caption)}</h3>", *_table(table)]
    return lines


def _table(table: ResultTable) -> list[str]:
    lines = ['<div class="wide"><table>', "<thead>"]
    if any(table.groups):
        width = len(table.columns)
        groups = "".join(f'<th class="group" colspan="{width}">{escape(group)}</th>' for group in table.groups)
        lines.append(f'<tr><th colspan="{len(table.label_columns)}"></th>{groups}</tr>')
    labels = "".join(f'<th class="label">{escape(name)}</th>' for name in table.label_columns)
    headings = "".join(f"<th>{escape(heading)}</th>" for heading in table.headings) * len(table.groups)
    lines += [f"<tr>{labels}{headings}</tr>", "</thead>"]
    for part in table.parts:
        lines.append("<tbody>")
        for row in part:
            cells = "".join(f'<th class="label">{escape(label)}</th>' for label in row.labels)
            for index, cell in enumerate(row.cells):
                mean, suffix = table.cell_text(index, cell)
                small = f'<span class="suffix">{escape(suffix)}</span>' if suffix else ""
                cells += f"<td>{_MARKS[cell.mark].format(mean)}{small}</td>"
            lines.append(f"<tr>{cells}</tr>")
        lines.append("</tbody>")
    return [*lines, "</table></div>", *(_paragraph(note, "note") for note in table.notes)]


def _options(what: str, options: FlatOptions) -> list[str]:
    return [_paragraph(f"{what}: {', '.join(f'{key}={value}' for key, value in options)}", "note")]


def _paragraph(text: str, kind: str = "") -> str:
    return f"<p{f' class={chr(34)}{kind}{chr(34)}' if kind else ''}>{escape(text)}</p>"
