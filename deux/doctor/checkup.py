"""What a check prints: headings, facts, tables and faults, which it counts."""

from collections.abc import Sequence

from rich.padding import Padding
from rich.table import Table

from deux.tasks.console import say


class Checkup:
    """Prints what the checks find; of something that was asked for and is missing it is told by `fault`.

    Attributes:
        faults: number of faults so far.
    """

    def __init__(self) -> None:
        self.faults = 0

    def heading(self, text: str) -> None:
        """Begin a group of facts."""
        say(f"\n{text}")

    def fact(self, name: str, value: str) -> None:
        """Print one fact on one line, however long."""
        say(f"  {name:<20} {value}")

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Print a table, its first column to the left and all others to the right."""
        table = Table(box=None, pad_edge=False, header_style="none", expand=False)
        for k, column in enumerate(columns):
            table.add_column(column, justify="right" if k else "left", no_wrap=True)
        for row in rows:
            table.add_row(*row)
        say(Padding(table, (0, 0, 0, 2), expand=False))

    def fault(self, sentence: str) -> None:
        """Print what is missing or wrong, and count it."""
        self.faults += 1
        say(f"  FAULT                {sentence}")
