"""Checks during training: finite loss, depth and weights, and depth that is stuck at an end of its range."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.utilities import rank_zero_warn
from torch import Tensor
from torch.optim import Optimizer

from deux.errors import DeuxError, counted, plural
from deux.registry import registry
from deux.training.module import DepthCompletion


@dataclass(frozen=True)
class _Reading:
    """Values of one step on their way from the device.

    Args:
        step: number of optimiser steps that were done.
        learning_rate: of that step.
        terms: names of the loss terms.
        values: the loss, the mean depth in metres and the terms, on the host once `arrived`.
        arrived: the end of the copy; None where there is none to wait for.
    """

    step: int
    learning_rate: float
    terms: tuple[str, ...]
    values: Tensor
    arrived: torch.cuda.Event | None

    def numbers(self) -> tuple[float, float, dict[str, float]]:
        """Loss, mean depth and the loss terms by name."""
        if self.arrived is not None:
            self.arrived.synchronize()
        loss, depth, *terms = self.values.tolist()
        return loss, depth, dict(zip(self.terms, terms, strict=True))


class HealthCheck(Callback):
    """Stops a run whose loss, depth or weights are not finite; warns once if the depth sticks to an end of its range.

    Too high a learning rate is the usual cause of a saturated output. The shipped models come back from it, where the
    rate is low enough; a model whose output has no gradient left there does not.

    No check but that of the first step waits for the device: its values are copied while the training goes on, and are
    looked at by the next check, by the end of the epoch, or before a checkpoint is written, whichever is first.
    Processes that train together look at the mean of all of them, so that all of them stop at the same step.

    Args:
        every: number of optimiser steps from one check to the next. There is one of the first step, too: of all later
            ones, weights that a broken loss has reached are what is seen.
        patience: number of checks in a row with stuck predictions after which to warn.
        margin: the mean prediction is stuck within this fraction of the range's far end, or of its near end.

    Raises:
        DeuxError: at the first step, when the loss has reached no weight of the depth model; during training, when the
            loss or the predicted depth is not finite; at the end of an epoch and
            before any checkpoint is written, when one of these or a weight is not.
    """

    def __init__(self, every: int = 20, patience: int = 5, margin: float = 0.05) -> None:
        self.every = every
        self.patience = patience
        self.margin = margin
        self.stuck_checks = 0
        self._reading: _Reading | None = None

    def on_before_optimizer_step(self, trainer: Trainer, pl_module: LightningModule, optimizer: Optimizer) -> None:
        """Check before the first step that the depth model has gradients, which a loss of poses alone leaves out."""
        if trainer.global_step > 0 or not isinstance(pl_module, DepthCompletion):
            return
        weights = [weight for weight in pl_module.model.parameters() if weight.requires_grad]
        if weights and all(weight.grad is None for weight in weights):
            terms = " and ".join(pl_module.objective.terms)
            raise DeuxError(
                f"the loss gives {registry().called(pl_module.model)} no gradient, though it has one for the poses: "
                f"none of its terms ({terms}) reads the depth, so give another one a weight above 0."
            )

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Begin a check of what `DepthCompletion.training_step` returned, if the optimiser has made a step with it."""
        stepped = (batch_idx + 1) % trainer.accumulate_grad_batches == 0 or trainer.is_last_batch
        due = trainer.global_step == 1 or trainer.global_step % self.every == 0
        if stepped and due and isinstance(pl_module, DepthCompletion):
            self._finish_check(pl_module)
            self._reading = _read(trainer, outputs)
            if trainer.global_step == 1:
                self._finish_check(pl_module)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Finish the last check, and check the weights."""
        self._check_all(trainer, pl_module)

    def on_save_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """As at the end of an epoch, so that nothing broken is written."""
        self._check_all(trainer, pl_module)

    def _check_all(self, trainer: Trainer, module: LightningModule) -> None:
        if isinstance(module, DepthCompletion):
            self._finish_check(module)
        # A pose network that gives NaN leaves nothing visible, and the loss stays finite.
        names, weights = zip(*module.named_parameters(), strict=True)
        finite = _mean_of_processes(torch.stack([weight.detach().isfinite().all() for weight in weights]).float())
        broken = [name for name, share in zip(names, finite.tolist(), strict=True) if share < 1]
        if broken:
            raise DeuxError(
                f"{counted(len(broken), 'tensor')} of weights {plural('is', len(broken))} not finite at step "
                f"{trainer.global_step}, {broken[0]} is the first: lower training.learning_rate, or set "
                "trainer.precision=32-true."
            )

    def _finish_check(self, module: DepthCompletion) -> None:
        """Judge the values that were read last, if they have not been judged yet."""
        if (reading := self._reading) is None:
            return
        self._reading = None
        (loss, depth, terms), model = reading.numbers(), module.model
        when = f"at step {reading.step}, learning rate {reading.learning_rate:g}"
        if not (math.isfinite(loss) and math.isfinite(depth)):
            broken = [name for name, value in terms.items() if not math.isfinite(value)]
            blamed = math.isfinite(depth) and len(broken) < len(terms)
            only = f" ({' and '.join(broken)} alone)" if blamed else ""
            advice = "lower training.learning_rate, or look for frames with broken values."
            if reading.step == 1:
                advice = (
                    "no weight had changed by then, so look at what computes it, and for frames with broken values."
                )
            raise DeuxError(f"the training loss is {loss}{only} and the mean depth {depth} {when}: {advice}")
        if reading.step % self.every != 0:
            return
        near = depth <= model.min_depth * (1 + self.margin)
        far = depth >= model.max_depth * (1 - self.margin)
        self.stuck_checks = self.stuck_checks + 1 if near or far else 0
        if self.stuck_checks == self.patience:
            end = "nearest" if near else "farthest"
            rank_zero_warn(
                f"The predicted depth has stuck to its {end} value ({depth:.2f} m on average) for "
                f"{self.every * self.patience} steps, {when}: the network has saturated; if it does not "
                "come back, start again with a lower training.learning_rate."
            )


def _read(trainer: Trainer, outputs: Mapping[str, Any]) -> _Reading:
    """Begin to copy the loss, the mean depth and the loss terms of a step to the host."""
    # Lightning has divided the loss by the number of batches whose gradients are accumulated.
    loss = outputs["loss"].detach() * trainer.accumulate_grad_batches
    terms = outputs["terms"]
    values = _mean_of_processes(torch.stack([loss, outputs["mean_depth"], *terms.values()]))
    copied = values.to("cpu", non_blocking=True)  # into pinned memory, where that is needed
    arrived = None
    if values.is_cuda:
        arrived = torch.cuda.Event()
        arrived.record()
    return _Reading(trainer.global_step, trainer.optimizers[0].param_groups[0]["lr"], tuple(terms), copied, arrived)


def _mean_of_processes(values: Tensor) -> Tensor:
    """The mean over all processes that train together, the same in each; not finite if it is not finite in one."""
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        torch.distributed.all_reduce(values)
        values = values / torch.distributed.get_world_size()
    return values
