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
    """Gives the model, at the end of its training, the mean of its weights after each step of the last part.

    The training itself goes on from the weights of the last step, and so do validations: what they log is not of the
    mean. The mean is in float32 and on the training's device whatever the precision. A checkpoint holds both, so that a
    training which was killed goes on as if it had never stopped; buffers are those of the last step.

    Args:
        fraction: of the training, from the end, that the mean is over; above 0, at most 1. It is of the optimiser
            steps, or of the epochs where these become longer (`deux.training.training_progress`).

    Raises:
        DeuxError: at the start of the training, if it has no end.
    """

    def __init__(self, fraction: float) -> None:
        super().__init__(use_buffers=False, avg_fn=_running_mean)
        self.fraction = fraction
        self._in_last_part = False

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Make the mean's tensors, if the training has an end."""
        check_end(trainer, self.fraction)
        super().setup(trainer, pl_module, stage)

    def should_update(self, step_idx: int | None = None, epoch_idx: int | None = None) -> bool:
        """Whether the step that is done belongs to the last part."""
        return step_idx is not None and self._in_last_part

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Bring the mean to the training's device."""
        assert self._average_model is not None
        self._average_model.to(pl_module.device)

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: STEP_OUTPUT, batch: Any, batch_idx: int
    ) -> None:
        """Count the weights in, if the step belongs to the last part."""
        done, steps = training_progress(trainer)
        # There is at least one step in the last part.
        self._in_last_part = done > min(steps - 1, round(steps * (1.0 - self.fraction)))
        super().on_train_batch_end(trainer, pl_module, outputs, batch, batch_idx)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Wait for `on_fit_end`, which also follows where a training is resumed that has no step left to do."""

    def on_fit_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Give the model the mean, unless the training ended before its last part."""
        assert self._average_model is not None
        if int(self._average_model.n_averaged) > 0:
            self._copy_average_to_current(pl_module)

    def on_validation_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Leave the weights of the last step: exchanging them would round them where the precisions differ."""

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Nothing was exchanged."""

    def on_load_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """Load the mean and the weights of the last step; a training without averaging goes on with it from here."""
        if "averaging_state" in checkpoint:
            super().on_load_checkpoint(trainer, pl_module, checkpoint)


def check_one_mean(fraction: float, callbacks: Sequence[Callback]) -> None:
    """Find two means of the weights, which keep each other's in the checkpoints and lose the weights themselves.

    Args:
        fraction: `training.averaging`; 0 for none.
        callbacks: all others of the training.

    Raises:
        DeuxError: more than one of them makes a mean.
    """
    names = [type(one).__name__ for one in callbacks if isinstance(one, WeightAveraging)]
    means = [*([f"training.averaging={fraction:g}"] if fraction else []), *(f"the callback {name}" for name in names)]
    if len(means) > 1:
        raise DeuxError(
            f"{' and '.join(means)} both make the trained model a mean of its weights: leave one of them out"
            f"{', such as by training.averaging=0' if fraction else ''}."
        )


def check_end(trainer: Trainer, fraction: float) -> None:
    """Raise DeuxError if a fraction of the training is to be averaged that has no end."""
    if trainer.max_steps == -1 and trainer.max_epochs == -1:
        raise DeuxError(
            f"training.averaging={fraction:g} is the last part of a training, and with trainer.max_epochs=-1 this one "
            "has no end: leave trainer.max_epochs to training.epochs, or set training.averaging=0."
        )


def _running_mean(mean: Tensor, weight: Tensor, count: Tensor | int) -> Tensor:
    """The mean of count + 1 values, in the precision of the mean."""
    return mean + (weight.to(mean.dtype) - mean) / (count + 1)
