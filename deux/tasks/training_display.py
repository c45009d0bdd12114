"""Progress display of a training; separate from `deux.tasks.console` since Lightning takes seconds to import."""

import math
import time
from typing import Any

from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback, RichProgressBar

from deux.tasks.console import minutes, say
from deux.training.training_progress import training_progress


def training_display(bar: bool) -> Callback:
    """Lightning's progress bar if `bar` is set, else a line after each validation."""
    return _LossBar() if bar else _ValidationLines()


class _ValidationLines(Callback):
    """Prints the step, the validation error and the remaining time after each validation."""

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Store time and step at which the training starts or resumes."""
        self._start, self._first = time.monotonic(), trainer.global_step

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Print the line."""
        if trainer.sanity_checking:
            return
        step, total = trainer.global_step, trainer.estimated_stepping_batches
        parts = [f"step {step:,}"]
        if math.isfinite(total):
            parts = [f"step {step:,} of {total:,}"]
        if (error := trainer.callback_metrics.get("validation/mae")) is not None:
            parts.append(f"validation MAE {float(error):.1f} mm")
        if math.isfinite(total) and self._first < step < total:
            seconds = (time.monotonic() - self._start) / (step - self._first) * (total - step)
            parts.append(f"{minutes(seconds)} left")
        say(f"  {', '.join(parts)}")

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Report a training that ended early."""
        _report_early_end(trainer)


class _LossBar(RichProgressBar):
    """Lightning's progress bar with the loss of the last logged step.

    With `prog_bar=True`, the loss would be read at every step, which synchronises with the GPU.
    """

    def __init__(self) -> None:
        super().__init__(leave=True)
        self._loss: dict[str, float] = {}

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Update the loss at logged steps, whose values are read anyway."""
        logged = trainer.global_step % trainer.log_every_n_steps == 0  # type: ignore[attr-defined]
        if logged and "train/loss" in trainer.callback_metrics:
            self._loss = {"loss": float(trainer.callback_metrics["train/loss"])}
        super().on_train_batch_end(trainer, pl_module, outputs, batch, batch_idx)

    def get_metrics(self, trainer: Trainer, pl_module: LightningModule) -> dict[str, Any]:
        """The values shown next to the bar."""
        return {**super().get_metrics(trainer, pl_module), **self._loss}

    def teardown(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Close the bar, and report a training that ended early."""
        super().teardown(trainer, pl_module, stage)
        _report_early_end(trainer)


def _report_early_end(trainer: Trainer) -> None:
    """Report that a training ended before its last step, and thus before the end of the learning rate schedule."""
    done, total = training_progress(trainer)
    if done < total < math.inf:
        say(
            f"  the training ended after {done:,} of {total:,} steps, stopped by trainer.max_time or a callback such "
            "as early_stopping"
        )
