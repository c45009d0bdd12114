"""What a run says while it works: one line for each stage, and a bar where somebody watches."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from lightning.pytorch.callbacks import Callback, RichProgressBar
from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from deux.configuration import in_sweep
from deux.data.progress import Progress as Report
from deux.data.progress import ignore_progress

_console = Console()


def say(message: RenderableType) -> None:
    """Print a line or a table."""
    _console.print(message, highlight=False)


def quieten_libraries() -> None:
    """Silence two notices that a user of this command can do nothing about."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    # Frames are decoded once and kept in memory, so workers would only copy them between processes.
    warnings.filterwarnings("ignore", message=".*does not have many workers")


def training_bar() -> list[Callback]:
    """Lightning's progress bar, where somebody watches a single run."""
    return [RichProgressBar(leave=True)] if _watched() else []


@contextmanager
def progress() -> Iterator[Report]:
    """A progress function for long work; it draws bars where somebody watches a single run."""
    if not _watched():
        yield ignore_progress
        return
    columns = (
        TextColumn("  {task.description:<16}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=_console) as bars:
        tasks = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield report


def _watched() -> bool:
    return _console.is_terminal and not in_sweep()
