"""What a run says while it works: one line for each stage, and a bar where somebody watches."""

import logging
import math
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from deux.configuration import in_sweep
from deux.errors import printable
from deux.io.progress import Progress as Report
from deux.training.ranks import leads

LINE_INTERVAL = 60.0
"""Seconds between two lines about the progress of one stage, where no bar is drawn."""

FILE_WIDTH = 200
"""Characters of a line that a table may take where it is written to a file: no heading is cut short there."""

_console = Console()


def say(message: RenderableType) -> None:
    """Print a line, however long, or a table. Of several processes that train together the leading one does."""
    if not leads():
        return
    if isinstance(message, str):
        text = "\n".join(printable(line) for line in message.split("\n"))
        _console.print(text, highlight=False, markup=False, soft_wrap=True)
    else:
        console = _console if _console.is_terminal else Console(width=FILE_WIDTH)
        console.print(message, highlight=False)


def quieten_libraries() -> None:
    """Silence warnings of Lightning's that a user of this command can do nothing about."""
    for notice in (
        "does not have many workers",  # frames are decoded once and kept in memory: workers would only copy them
        "is smaller than the logging interval",  # a run of a few steps logs what it can
        "You have overridden `on_after_batch_transfer`",  # the module's is the one that is meant
        "`isinstance.treespec, LeafSpec.` is deprecated",  # Lightning's own use of torch
        r"Found \d+ module\(s\) in eval mode",  # a frozen part of a model
        "The combination of `DataLoader",  # a loader and its workers are kept until the datasets change, and ended then
        "It is recommended to use .*sync_dist=True",  # all processes validate on the same frames
        "Checkpoint directory .* exists and is not empty",  # a run that goes on where it was killed
        "The `srun` command is available",  # on a machine of a Slurm cluster, without a job or in a job of one process
    ):
        warnings.filterwarnings("ignore", message=f".*{notice}")


def quieten_trainer() -> None:
    """Silence the Trainer's log below warnings. Call it once Lightning is imported, which sets its own level."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)


@contextmanager
def progress() -> Iterator[Report]:
    """A progress function for long work: bars where somebody watches a single run, else a line every minute."""
    if not watched():
        yield _progress_lines()
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


def _progress_lines() -> Report:
    """A progress function that says how far a stage is, and how long the rest will take, `LINE_INTERVAL` apart."""
    begun: dict[str, tuple[float, int]] = {}
    last: dict[str, float] = {}

    def report(stage: str, done: int, total: int) -> None:
        now = time.monotonic()
        start, first = begun.setdefault(stage, (now, done))
        if now - last.setdefault(stage, start) < LINE_INTERVAL or done == total:
            return
        last[stage] = now
        left = f", {minutes((now - start) / (done - first) * (total - done))} left" if done > first else ""
        say(f"  {stage}: {done:,} of {total:,}{left}")

    return report


def minutes(seconds: float) -> str:
    """A duration as "3 min", rounded up."""
    return f"{math.ceil(seconds / 60):,} min"


def watched() -> bool:
    """Whether somebody watches a single run: then there are progress bars."""
    return _console.is_terminal and not in_sweep() and leads()
