"""The report of the checks: headings, facts, tables and faults, printed at once and collected for `--json`."""

from collections.abc import Sequence
from typing import Any

from rich.padding import Padding
from rich.table import Table

from deux.tasks.console import say


class Checkup:
    """Collects and prints the results of checks. A fault is a requirement of the configuration that is not met.

    Args:
        show: whether results are printed at once.

    Attributes:
        faults: number of faults so far.
    """

    def __init__(self, show: bool = True) -> None:
        self.faults = 0
        self._show = show
        self._sections: list[dict[str, Any]] = []

    def heading(self, text: str) -> None:
        """Start a section."""
        self._sections.append({"heading": text, "facts": [], "tables": [], "lines": [], "faults": []})
        if self._show:
            say(f"\n{text}")

    def fact(self, name: str, value: str) -> None:
        """Report one fact, on one line of any length."""
        self._add("facts", [name.strip(), value])
        if self._show:
            say(f"  {name:<20} {value}")

    def line(self, text: str) -> None:
        """Report a line of text."""
        self._add("lines", text)
        if self._show:
            say(f"  {text}")

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Report a table; the first column is aligned to the left, the others to the right."""
        self._add("tables", [dict(zip(columns, row, strict=True)) for row in rows])
        if not self._show:
            return
        table = Table(box=None, pad_edge=False, header_style="none", expand=False)
        for k, column in enumerate(columns):
            table.add_column(column, justify="right" if k else "left", no_wrap=True)
        for row in rows:
            table.add_row(*row)
        say(Padding(table, (0, 0, 0, 2), expand=False))

    def fault(self, message: str) -> None:
        """Report a fault."""
        self.count(message)
        if self._show:
            say(f"  FAULT                {message}")

    def count(self, message: str) -> None:
        """Add a fault that was already printed."""
        self.faults += 1
        self._add("faults", message)

    def as_json(self) -> dict[str, Any]:
        """All results as JSON values: the number of faults, and the sections in order."""
        return {"faults": self.faults, "sections": self._sections}

    def _add(self, what: str, value: Any) -> None:
        if not self._sections:
            self.heading("Checkup")
        self._sections[-1][what].append(value)
