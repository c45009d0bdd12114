"""The report as one HTML page that needs no other file."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from deux.report.conditions import Facts
from deux.report.contents import Contents, Section
from deux.report.figures import Picture
from deux.report.tables import METRICS, Table, number_text

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
.behind { color: #6a6f75; font-size: 11px; }
.note { color: #4a4f55; font-size: 13px; margin: .1rem 0; }
.missing { background: #fff6e0; padding: .5rem 1rem; }
img { max-width: 100%; }
figure { margin: 1.2rem 0; }
pre { background: #f3f4f6; padding: .6rem; white-space: pre-wrap; overflow-wrap: anywhere; font-size: 12px; }
""".strip()

_MIME = {".png": "image/png", ".jpg": "image/jpeg"}


def html_page(contents: Contents, pictures: Mapping[str, Sequence[Picture]]) -> str:
    """The whole report as a page, its figures within it.

    Args:
        contents: tables, commands and what is missing.
        pictures: the figures by the name of the table that they belong to.
    """
    state = f"{contents.finished} finished runs, {contents.missing} missing"
    body = [
        "<h1>Report</h1>",
        _paragraph(f"{state}, below {contents.folder}."),
        "<ul>",
        *(f'<li><a href="#{s.table.name}">{escape(s.title)}</a>: {s.state}</li>' for s in contents.sections),
        "</ul>",
        *(_paragraph(note, "note") for note in contents.notes),
    ]
    for section in contents.sections:
        body += _section(section, pictures.get(section.table.name, ()))
    head = f'<meta charset="utf-8"><title>Report: {escape(state)}</title><style>{_STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head>\n<body>\n' + "\n".join(body) + "\n</body></html>\n"


def _section(section: Section, pictures: Iterable[Picture]) -> list[str]:
    lines = [f'<h2 id="{section.table.name}">{escape(section.title)}</h2>', *_table(section.table)]
    lines += [_paragraph(note, "note") for note in section.table.notes]
    if section.missing:
        missing = "".join(f"<li>{escape(line)}</li>" for line in section.missing)
        lines.append(
            f'<div class="missing"><b>Missing: {len(section.comparison.missing)} runs</b><ul>{missing}</ul></div>'
        )
    for picture in pictures:
        content = base64.b64encode(picture.file.read_bytes()).decode()
        source = f"data:{_MIME[picture.file.suffix]};base64,{content}"
        caption = escape(picture.caption)
        lines.append(f'<figure><img src="{source}" alt="{caption}"><figcaption>{caption}</figcaption></figure>')
    lines.append("<h3>Commands</h3>")
    lines += [f"<pre>{escape(command)}</pre>" for command in section.commands]
    lines.append("<details><summary>Training and test frames</summary>")
    lines += _facts("trained", section.comparison.training) + _facts("tested", section.comparison.testing)
    return [*lines, "</details>"]


def _table(table: Table) -> list[str]:
    labels = len(table.label_columns)
    lines = ['<div class="wide"><table>', "<thead>"]
    if any(table.groups):
        groups = "".join(f'<th class="group" colspan="{len(METRICS)}">{escape(group)}</th>' for group in table.groups)
        lines.append(f'<tr><th colspan="{labels}"></th>{groups}</tr>')
    heads = "".join(f'<th class="label">{escape(name)}</th>' for name in table.label_columns)
    metrics = "".join(f"<th>{metric}</th>" for metric in METRICS) * len(table.groups)
    lines += [f"<tr>{heads}{metrics}</tr>", "</thead>"]
    marks = table.marks
    for part, rows in enumerate(table.parts):
        lines.append("<tbody>")
        for index, row in enumerate(rows):
            cells = "".join(f'<th class="label">{escape(label)}</th>' for label in row.labels)
            for column, number in enumerate(row.numbers):
                mean, behind = number_text(number, table.usual_seeds)
                wrapped = {"best": "<b>{}</b>", "second": "<u>{}</u>", None: "{}"}[marks.get((part, index, column))]
                small = f'<span class="behind">{escape(behind)}</span>' if behind else ""
                cells += f"<td>{wrapped.format(mean)}{small}</td>"
            lines.append(f"<tr>{cells}</tr>")
        lines.append("</tbody>")
    return [*lines, "</table></div>"]


def _facts(what: str, facts: Facts) -> list[str]:
    return [_paragraph(f"{what}: {', '.join(f'{key}={value}' for key, value in facts)}", "note")]


def _paragraph(text: str, kind: str = "") -> str:
    return f"<p{f' class={chr(34)}{kind}{chr(34)}' if kind else ''}>{escape(text)}</p>"
