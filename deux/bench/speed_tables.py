"""Tables of benchmark results, as text and JSON."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from deux.bench.timing import Spread

Value = str | int | Spread


@dataclass(frozen=True)
class SpeedTable:
    """Table of the results of a benchmark.

    Args:
        name: short name of the table.
        title: title of the table.
        rows: values by column name; all rows have the same columns.
        notes: notes for the reader, for example on what was excluded and why.
    """

    name: str
    title: str
    rows: tuple[Mapping[str, Value], ...]
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The table as JSON values; a `Spread` becomes an object with `median`, `low` and `high`."""
        return {
            "name": self.name,
            "title": self.title,
            "rows": [
                {column: asdict(value) if isinstance(value, Spread) else value for column, value in row.items()}
                for row in self.rows
            ],
            "notes": list(self.notes),
        }


def make_console() -> Console:
    """Create a console on standard output: coloured tables on a terminal, otherwise Markdown without line wrapping."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=1000)


def print_table(console: Console, table: SpeedTable) -> None:
    """Print a table with its title above and its notes below it."""
    plain = not console.is_terminal
    drawn = Table(box=box.MARKDOWN if plain else box.SIMPLE)
    for column in table.rows[0] if table.rows else ():
        drawn.add_column(column, justify="left" if isinstance(table.rows[0][column], str) else "right")
    for row in table.rows:
        drawn.add_row(*(str(value) for value in row.values()))
    console.print(table.title, style="bold", markup=False)
    console.print(drawn)
    for note in table.notes:
        console.print(note, markup=False)
    console.print()
