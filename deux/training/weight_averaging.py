"""The mean of the weights over the last steps of a training (tail averaging, Polyak and Juditsky 1992)."""

from collections.abc import Sequence
from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import WeightAveraging
from lightning.pytorch.utilities.types import STEP_OUTPUT
from torch import Tensor

from deux.errors import DeuxError
from deux.training.training_progress import training_progress


class TailAveraging(WeightAveraging):
    """At the end of the training, replaces the weights by their mean over the steps of the last part of it.

    Training and validation use the weights of the last step, not the mean. The mean is float32, on the training's
    device, whatever the precision. Checkpoints contain both, so that a resumed training is identical to an
    uninterrupted one. Buffers are those of the last step.

    Args:
        fraction: fraction of the training, from its end, to average over; above 0, at most 1. It is a fraction of the
            optimiser steps or, if epochs become longer, of the epochs (`deux.training.training_progress`).

    Raises:
        DeuxError: at the start of the training, if it has no end.
    """

    def __init__(self, fraction: float) -> None:
        super().__init__(use_buffers=False, avg_fn=_running_mean)
        self.fraction = fraction
        self._in_last_part = False

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Create the mean's tensors; raises DeuxError if the training has no end."""
        check_end(trainer, self.fraction)
        super().setup(trainer, pl_module, stage)

    def should_update(self, step_idx: int | None = None, epoch_idx: int | None = None) -> bool:
        """Whether the finished step belongs to the last part."""
        return step_idx is not None and self._in_last_part

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Move the mean to the training's device."""
        assert self._average_model is not None
        self._average_model.to(pl_module.device)

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: STEP_OUTPUT, batch: Any, batch_idx: int
    ) -> None:
        """Update the mean, if the step belongs to the last part, which has at least one step."""
        done, total = training_progress(trainer)
        self._in_last_part = done > min(total - 1, round(total * (1.0 - self.fraction)))
        super().on_train_batch_end(trainer, pl_module, outputs, batch, batch_idx)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Do nothing: unlike this hook, `on_fit_end` also runs for a resumed training that has no step left."""

    def on_fit_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Copy the mean to the model, unless the training ended before its last part."""
        assert self._average_model is not None
        if int(self._average_model.n_averaged) > 0:
            self._copy_average_to_current(pl_module)

    def on_validation_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Do not swap in the mean: if the precisions differ, swapping would round the weights."""

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Nothing was swapped."""

    def on_load_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """Restore mean and weights; averaging starts here if the checkpoint was written without it."""
        if "averaging_state" in checkpoint:
            super().on_load_checkpoint(trainer, pl_module, checkpoint)


def check_one_mean(fraction: float, callbacks: Sequence[Callback]) -> None:
    """Check that at most one callback averages weights: two would overwrite the weights in the checkpoints.

    Args:
        fraction: `training.averaging`; 0 for none.
        callbacks: all other callbacks of the training.

    Raises:
        DeuxError: more than one of them averages the weights.
    """
    names = [type(one).__name__ for one in callbacks if isinstance(one, WeightAveraging)]
    means = [*([f"training.averaging={fraction:g}"] if fraction else []), *(f"the callback {name}" for name in names)]
    if len(means) > 1:
        raise DeuxError(
            f"{' and '.join(means)} both average the weights of the trained model: leave one of them out"
            f"{', such as by training.averaging=0' if fraction else ''}."
        )


def check_end(trainer: Trainer, fraction: float) -> None:
    """Raise DeuxError if the training, of which a fraction is to be averaged, has no end."""
    if trainer.max_steps == -1 and trainer.max_epochs == -1:
        raise DeuxError(
            f"training.averaging={fraction:g} is the last part of a training, and with trainer.max_epochs=-1 this one "
            "has no end: leave trainer.max_epochs to training.epochs, or set training.averaging=0."
        )


def _running_mean(mean: Tensor, weight: Tensor, count: Tensor | int) -> Tensor:
    """The mean of count + 1 values, in the precision of the mean."""
    return mean + (weight.to(mean.dtype) - mean) / (count + 1)
