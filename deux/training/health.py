"""Checks during training: finite loss, depth and weights, and depth that is stuck at an end of its range."""

import math
from collections.abc import Mapping
from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.utilities import rank_zero_warn

from deux.errors import DeuxError
from deux.training.module import DepthCompletion


class HealthCheck(Callback):
    """Stops a run whose loss, depth or weights are not finite; warns once if the depth sticks to an end of its range.

    A network that saturates its output has almost no gradient left and seldom comes back; too high a learning rate
    is the usual cause.

    Args:
        every: number of optimiser steps from one check to the next; a check waits for the device.
        patience: number of checks in a row with stuck predictions after which to warn.
        margin: the mean prediction is stuck within this fraction of the range's far end, or of its near end.

    Raises:
        DeuxError: during training, when the loss or the predicted depth is not finite; at the end of an epoch, before
            its checkpoint is written, when a weight is not.
    """

    def __init__(self, every: int = 20, patience: int = 5, margin: float = 0.05) -> None:
        self.every = every
        self.patience = patience
        self.margin = margin
        self.stuck_checks = 0

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Check what `DepthCompletion.training_step` returned, if the optimiser has made a step with it."""
        stepped = (batch_idx + 1) % trainer.accumulate_grad_batches == 0 or trainer.is_last_batch
        if stepped and trainer.global_step % self.every == 0 and isinstance(pl_module, DepthCompletion):
            self._check(trainer.global_step, pl_module, outputs)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Check the weights: a pose network that gives NaN leaves nothing visible, and the loss stays finite."""
        broken = [name for name, weight in pl_module.named_parameters() if not weight.isfinite().all()]
        if broken:
            raise DeuxError(
                f"{len(broken)} tensors of weights are not finite at step {trainer.global_step}, {broken[0]} is the "
                "first: lower training.learning_rate, or set trainer.precision=32-true."
            )

    def _check(self, step: int, module: DepthCompletion, outputs: Mapping[str, Any]) -> None:
        rate = module.trainer.optimizers[0].param_groups[0]["lr"]
        # Lightning has divided the loss by the number of batches whose gradients are accumulated.
        loss = float(outputs["loss"]) * module.trainer.accumulate_grad_batches
        depth, model = float(outputs["mean_depth"]), module.model
        if not (math.isfinite(loss) and math.isfinite(depth)):
            raise DeuxError(
                f"the training loss is {loss} and the mean depth {depth} at step {step}, learning rate {rate:g}: lower "
                "training.learning_rate, or look for frames with broken values."
            )
        near = depth <= model.min_depth * (1 + self.margin)
        far = depth >= model.max_depth * (1 - self.margin)
        self.stuck_checks = self.stuck_checks + 1 if near or far else 0
        if self.stuck_checks == self.patience:
            end = "nearest" if near else "farthest"
            rank_zero_warn(
                f"The predicted depth has stuck to its {end} value ({depth:.2f} m on average) for "
                f"{self.every * self.patience} steps, at step {step}, learning rate {rate:g}: the network has "
                "saturated and will not recover, so start again with a lower training.learning_rate."
            )
