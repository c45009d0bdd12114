"""A table as text in cells, for the console and for a page."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table

from deux.metrics.intervals import Estimate


class Cell(NamedTuple):
    """What stands in one place of a table, and whether it stands out."""

    text: str
    bold: bool = False


def estimate_cell(value: Estimate, digits: int, factor: float = 1.0, bold: bool = False) -> Cell:
    """A mean and half its interval as "12.3 ± 0.4"; the mean alone where there is no interval, "-" without a mean."""
    if math.isnan(value.mean):
        return Cell("-")
    mean, half_width = (f"{number * factor:z.{digits}f}" for number in value)  # z: no minus before a zero
    return Cell(mean if math.isnan(value.half_width) else f"{mean} ± {half_width}", bold)


@dataclass(frozen=True)
class Sheet:
    """A table.

    Args:
        title: what it shows, without a full stop.
        header: a name for each column.
        rows: as many cells each.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def rich(self) -> Table:
        """For the console."""
        table = Table(title=escape(self.title))
        for index, name in enumerate(self.header):
            table.add_column(escape(name), justify="right" if index else "left")
        for row in self.rows:
            table.add_row(*(f"[bold]{escape(cell.text)}[/bold]" if cell.bold else escape(cell.text) for cell in row))
        return table

    def markdown(self) -> str:
        """For a page."""
        rows = [[f"**{cell.text}**" if cell.bold else cell.text for cell in row] for row in self.rows]
        rule = ["---", *["---:"] * (len(self.header) - 1)]
        lines = [f"| {' | '.join(row)} |" for row in (self.header, rule, *rows)]
        return "\n".join([f"{self.title}:", "", *lines, ""])
