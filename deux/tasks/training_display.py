"""What a training shows of its progress, apart from the rest of the console since Lightning takes seconds to import."""

import math
import time
from typing import Any

from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback, RichProgressBar

from deux.tasks.console import minutes, say
from deux.training.training_progress import training_progress


def training_display(bar: bool) -> Callback:
    """Lightning's progress bar, or else a line at each validation."""
    return _LossBar() if bar else _ValidationLines()


class _ValidationLines(Callback):
    """Says at each validation how far the training is, what it has reached, and how long the rest will take."""

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Note when, and with which step, the training begins or goes on."""
        self._start, self._first = time.monotonic(), trainer.global_step

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Say it."""
        if trainer.sanity_checking:
            return
        step, total = trainer.global_step, trainer.estimated_stepping_batches
        words = [f"step {step:,}"]
        if math.isfinite(total):
            words = [f"step {step:,} of {total:,}"]
        if (error := trainer.callback_metrics.get("validation/mae")) is not None:
            words.append(f"validation MAE {float(error):.1f} mm")
        if math.isfinite(total) and self._first < step < total:
            seconds = (time.monotonic() - self._start) / (step - self._first) * (total - step)
            words.append(f"{minutes(seconds)} left")
        say(f"  {', '.join(words)}")

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Say where the training ended, if that was too early."""
        _say_early_end(trainer)


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

    def teardown(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """End the bar, and say below it where the training ended, if that was too early."""
        super().teardown(trainer, pl_module, stage)
        _say_early_end(trainer)


def _say_early_end(trainer: Trainer) -> None:
    """Say that a training ended before its last step, which its learning rate's schedule counts on."""
    done, total = training_progress(trainer)
    if done < total < math.inf:
        say(
            f"  the training ended after {done:,} of {total:,} steps: trainer.max_time or a callback such as "
            "early_stopping asked for it"
        )
