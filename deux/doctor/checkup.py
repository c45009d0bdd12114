"""What a checkup finds: headings, facts, tables and faults, printed as they come and kept for `--json`."""

from collections.abc import Sequence
from typing import Any

from rich.padding import Padding
from rich.table import Table

from deux.tasks.console import say


class Checkup:
    """Takes what the checks find; of something that was asked for and is missing it is told by `fault`.

    Args:
        show: whether what is found is printed at once.

    Attributes:
        faults: number of faults so far.
    """

    def __init__(self, show: bool = True) -> None:
        self.faults = 0
        self._show = show
        self._sections: list[dict[str, Any]] = []

    def heading(self, text: str) -> None:
        """Begin a group of facts."""
        self._sections.append({"heading": text, "facts": [], "tables": [], "lines": [], "faults": []})
        if self._show:
            say(f"\n{text}")

    def fact(self, name: str, value: str) -> None:
        """Report one fact, on one line, however long."""
        self._keep("facts", [name.strip(), value])
        if self._show:
            say(f"  {name:<20} {value}")

    def line(self, text: str) -> None:
        """Report a line that has no name."""
        self._keep("lines", text)
        if self._show:
            say(f"  {text}")

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Report a table, its first column to the left and all others to the right."""
        self._keep("tables", [dict(zip(columns, row, strict=True)) for row in rows])
        if not self._show:
            return
        table = Table(box=None, pad_edge=False, header_style="none", expand=False)
        for k, column in enumerate(columns):
            table.add_column(column, justify="right" if k else "left", no_wrap=True)
        for row in rows:
            table.add_row(*row)
        say(Padding(table, (0, 0, 0, 2), expand=False))

    def fault(self, sentence: str) -> None:
        """Report what is missing or wrong, and count it."""
        self.count(sentence)
        if self._show:
            say(f"  FAULT                {sentence}")

    def count(self, sentence: str) -> None:
        """Count a fault that has been printed already."""
        self.faults += 1
        self._keep("faults", sentence)

    def as_json(self) -> dict[str, Any]:
        """All that was found, as JSON values: the number of faults, and the sections in their order."""
        return {"faults": self.faults, "sections": self._sections}

    def _keep(self, what: str, value: Any) -> None:
        if not self._sections:
            self.heading("Checkup")
        self._sections[-1][what].append(value)
