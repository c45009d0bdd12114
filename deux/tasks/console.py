"""Console output of a run: a line for each stage, and progress bars in an interactive terminal."""

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
"""Seconds between two progress lines of a stage, where there is no progress bar."""

FILE_WIDTH = 200
"""Maximal width in characters of tables whose output goes to a file; wide enough not to cut headings."""

_console = Console()


def say(message: RenderableType) -> None:
    """Print a line of any length, or a table. Of several processes that train together, only rank 0 prints."""
    if not leads():
        return
    if isinstance(message, str):
        text = "\n".join(printable(line) for line in message.split("\n"))
        _console.print(text, highlight=False, markup=False, soft_wrap=True)
    else:
        console = _console if _console.is_terminal else Console(width=FILE_WIDTH)
        console.print(message, highlight=False)


def quieten_libraries() -> None:
    """Silence Lightning warnings that users of the command line cannot act on."""
    for notice in (
        "does not have many workers",  # frames are decoded once and cached in memory: workers would only copy them
        "is smaller than the logging interval",  # in a run of a few steps
        "You have overridden `on_after_batch_transfer`",  # on purpose, in the module
        "`isinstance.treespec, LeafSpec.` is deprecated",  # Lightning's own use of torch
        r"Found \d+ module\(s\) in eval mode",  # a frozen part of a model
        "The combination of `DataLoader",  # workers persist until the datasets change, and are shut down then
        "It is recommended to use .*sync_dist=True",  # all processes validate on the same frames
        "Checkpoint directory .* exists and is not empty",  # a run that is resumed
        "The `srun` command is available",  # on a Slurm machine, without a job or in a job of one process
    ):
        warnings.filterwarnings("ignore", message=f".*{notice}")


def quieten_trainer() -> None:
    """Silence the Trainer's log below warnings. Call it after importing Lightning, which sets its own level."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)


@contextmanager
def progress() -> Iterator[Report]:
    """A progress callback for long work: progress bars in an interactive run, else a line every minute."""
    if not is_interactive():
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
    """A progress callback that prints the progress and the remaining time of a stage every `LINE_INTERVAL` seconds."""
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


def is_interactive() -> bool:
    """Whether this is a single run in a terminal, which gets progress bars."""
    return _console.is_terminal and not in_sweep() and leads()
