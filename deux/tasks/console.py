"""What a run says while it works: one line for each stage, and a bar where somebody watches."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback, RichProgressBar
from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from deux.configuration import in_sweep
from deux.io.progress import Progress as Report
from deux.io.progress import ignore_progress
from deux.training.ranks import leads

_console = Console()


def say(message: RenderableType) -> None:
    """Print a line, however long, or a table. Of several processes that train together the leading one does."""
    text = isinstance(message, str)
    if leads():
        _console.print(message, highlight=False, markup=not text, soft_wrap=text)


def quieten_libraries() -> None:
    """Silence notices of Lightning's that a user of this command can do nothing about."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    for notice in (
        "does not have many workers",  # frames are decoded once and kept in memory: workers would only copy them
        "is smaller than the logging interval",  # a run of a few steps logs what it can
        "You have overridden `on_after_batch_transfer`",  # the module's is the one that is meant
        "`isinstance.treespec, LeafSpec.` is deprecated",  # Lightning's own use of torch
        r"Found \d+ module\(s\) in eval mode",  # a frozen part of a model
        "The combination of `DataLoader",  # a loader and its workers are kept until the datasets change, and ended then
        "It is recommended to use .*sync_dist=True",  # all processes validate on the same frames
        "Checkpoint directory .* exists and is not empty",  # a run that goes on where it was killed
    ):
        warnings.filterwarnings("ignore", message=f".*{notice}")


def training_bar() -> list[Callback]:
    """Lightning's progress bar, where somebody watches a single run."""
    return [_LossBar()] if _watched() else []


class _LossBar(RichProgressBar):
    """Lightning's progress bar with the loss of the last step that was logged.

    A loss that is logged with `prog_bar=True` is read at every step, for which a card has to be waited for.
    """

    def __init__(self) -> None:
        super().__init__(leave=True)
        self._loss: dict[str, float] = {}

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Show the loss of this step if it is one whose values are read anyway."""
        logged = trainer.global_step % trainer.log_every_n_steps == 0  # type: ignore[attr-defined]
        if logged and "train/loss" in trainer.callback_metrics:
            self._loss = {"loss": float(trainer.callback_metrics["train/loss"])}
        super().on_train_batch_end(trainer, pl_module, outputs, batch, batch_idx)

    def get_metrics(self, trainer: Trainer, pl_module: LightningModule) -> dict[str, Any]:
        """What stands beside the bar."""
        return {**super().get_metrics(trainer, pl_module), **self._loss}


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
    return _console.is_terminal and not in_sweep() and leads()
