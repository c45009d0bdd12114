"""The progress bar of a training, apart from the rest of the console since Lightning takes seconds to import."""

from typing import Any

from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback, RichProgressBar

from deux.tasks.console import watched


def training_bar() -> list[Callback]:
    """Lightning's progress bar, where somebody watches a single run."""
    return [_LossBar()] if watched() else []


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
