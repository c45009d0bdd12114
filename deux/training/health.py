"""Checks during training: loss, depth and weights are finite, and depth is not saturated at an end of its range."""

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
    """Values of one step that are being copied from the device.

    Args:
        step: optimiser steps done.
        learning_rate: the step's learning rate.
        terms: names of the loss terms.
        values: the loss, the mean depth in metres and the terms, then for each of these the first step at which it was
            not finite, inf if none; valid on the host after `wait`.
        arrived: signals the end of the copy; None if the copy was synchronous.
    """

    step: int
    learning_rate: float
    terms: tuple[str, ...]
    values: Tensor
    arrived: torch.cuda.Event | None

    def wait(self) -> None:
        """Wait for the end of the copy."""
        if self.arrived is not None:
            self.arrived.synchronize()

    @property
    def when(self) -> str:
        """The step and its learning rate, for messages."""
        return f"at step {self.step}, learning rate {self.learning_rate:g}"

    @property
    def depth(self) -> float:
        """Mean predicted depth in metres."""
        _, depth, *_ = self.values.tolist()
        return float(depth)

    def check_finite(self) -> None:
        """Raise DeuxError unless the loss, its terms and the mean depth have been finite in all steps so far."""
        numbers = self.values.tolist()
        (loss, depth, *_), firsts = numbers[: len(numbers) // 2], numbers[len(numbers) // 2 :]
        _, of_depth, *of_terms = firsts
        first = min(firsts)
        if math.isinf(first):
            return
        broken = [f"objective.{name}" for name, step in zip(self.terms, of_terms, strict=True) if step == first]
        what = (
            f"the training loss is not finite from step {first:.0f} on (loss {loss}, mean depth {depth} m {self.when})"
        )
        cause = "lower training.learning_rate"
        if first < of_depth and len(broken) < len(self.terms):
            what += f", while the depth and all terms but {' and '.join(broken)} were finite then"
            cause = f"look at what computes {'it' if len(broken) == 1 else 'them'}, or {cause}"
        if first == 1:
            cause = "no weight had changed by then, so look at what computes it"
        raise DeuxError(f"{what}: {cause}, or look for frames with broken values.")


class HealthCheck(Callback):
    """Stops a training if loss, depth or weights are not finite; warns once if the depth saturates.

    The usual cause of depth saturated at an end of its range is too high a learning rate. The shipped models recover at
    a lower rate; a model whose gradient vanishes there does not.

    The first step at which each value is not finite is kept on the device. Only the check of the first step waits for
    it. The values of later ones are copied asynchronously and checked at the next check, at the end of the epoch or
    before a checkpoint is written, whichever is first. Processes
    that train together check the mean of their values, so that all stop at the same step.

    Args:
        every: number of optimiser steps between checks. The first step is checked too: its loss, unlike later ones, was
            computed with weights that no broken loss can have changed.
        patience: number of consecutive checks with saturated depth after which to warn.
        margin: the mean depth is saturated within this fraction of the far end of the range, or of its near end.

    Raises:
        DeuxError: at the first step, if the loss has no gradient for any weight of the depth model; during training, if
            the loss or the predicted depth is not finite; at the end of an epoch and before a checkpoint is written, if
            one of these or a weight is not finite.
    """

    def __init__(self, every: int = 20, patience: int = 5, margin: float = 0.05) -> None:
        self.every = every
        self.patience = patience
        self.margin = margin
        self.saturated_checks = 0
        self._terms: tuple[str, ...] = ()
        self._values: Tensor | None = None
        self._firsts: Tensor | None = None
        self._reading: _Reading | None = None
        self._read_at = 0

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
        """Keep the values of `DepthCompletion.training_step`, and check them if a check is due after the step."""
        if not isinstance(pl_module, DepthCompletion):
            return
        stepped = (batch_idx + 1) % trainer.accumulate_grad_batches == 0 or trainer.is_last_batch
        self._keep(trainer, outputs, trainer.global_step if stepped else trainer.global_step + 1)
        due = trainer.global_step == 1 or trainer.global_step % self.every == 0
        if stepped and due:
            self._finish_check(pl_module)
            self._start_check(trainer)
            if trainer.global_step == 1:
                self._finish_check(pl_module)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Finish the last check, and check the weights."""
        self._check_all(trainer, pl_module)

    def on_save_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """Check as at the end of an epoch, so that no broken weights are written."""
        self._check_all(trainer, pl_module)

    def _check_all(self, trainer: Trainer, module: LightningModule) -> None:
        if isinstance(module, DepthCompletion):
            self._finish_check(module)
            if self._read_at < trainer.global_step:
                self._start_check(trainer)
                self._finish_check(module)
        # The weights are checked, too: if a pose network returns NaN, nothing is visible and the loss stays finite.
        names, weights = zip(*module.named_parameters(), strict=True)
        finite = _mean_of_processes(torch.stack([weight.detach().isfinite().all() for weight in weights]).float())
        broken = [name for name, share in zip(names, finite.tolist(), strict=True) if share < 1]
        if broken:
            raise DeuxError(
                f"{counted(len(broken), 'tensor')} of weights {plural('is', len(broken))} not finite at step "
                f"{trainer.global_step}, {broken[0]} is the first: lower training.learning_rate, or set "
                "trainer.precision=32-true."
            )

    def _keep(self, trainer: Trainer, outputs: Mapping[str, Any], step: int) -> None:
        """Keep loss, mean depth and loss terms of a step, and the first step at which each of them is not finite."""
        # Lightning has divided the loss by accumulate_grad_batches.
        loss = outputs["loss"].detach() * trainer.accumulate_grad_batches
        terms = outputs["terms"]
        self._terms = tuple(terms)
        self._values = torch.stack([loss, outputs["mean_depth"], *terms.values()])
        firsts = torch.full_like(self._values, step).masked_fill_(self._values.isfinite(), math.inf)
        self._firsts = firsts if self._firsts is None else torch.minimum(self._firsts, firsts)

    def _start_check(self, trainer: Trainer) -> None:
        """Start to copy the values of the last step to the host."""
        if self._values is None or self._firsts is None:
            return
        self._read_at = trainer.global_step
        values = torch.cat([_mean_of_processes(self._values), _least_of_processes(self._firsts)])
        copied = values.to("cpu", non_blocking=True)
        arrived = None
        if values.is_cuda:
            arrived = torch.cuda.Event()
            arrived.record()
        learning_rate = trainer.optimizers[0].param_groups[0]["lr"]
        self._reading = _Reading(trainer.global_step, learning_rate, self._terms, copied, arrived)

    def _finish_check(self, module: DepthCompletion) -> None:
        """Check the values that were read last, if they have not been checked yet."""
        if (reading := self._reading) is None:
            return
        self._reading = None
        reading.wait()
        reading.check_finite()
        if reading.step % self.every == 0:
            self._warn_if_saturated(reading, module.model.min_depth, module.model.max_depth)

    def _warn_if_saturated(self, reading: _Reading, min_depth: float, max_depth: float) -> None:
        near = reading.depth <= min_depth * (1 + self.margin)
        far = reading.depth >= max_depth * (1 - self.margin)
        self.saturated_checks = self.saturated_checks + 1 if near or far else 0
        if self.saturated_checks == self.patience:
            end = "nearest" if near else "farthest"
            rank_zero_warn(
                f"The predicted depth has stuck to its {end} value ({reading.depth:.2f} m on average) for "
                f"{self.every * self.patience} steps, {reading.when}: the network has saturated; if it does not "
                "recover, start again with a lower training.learning_rate."
            )


def _mean_of_processes(values: Tensor) -> Tensor:
    """The mean over all processes that train together; not finite if it is not finite in one of them."""
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        values = values.clone()
        torch.distributed.all_reduce(values)
        values = values / torch.distributed.get_world_size()
    return values


def _least_of_processes(values: Tensor) -> Tensor:
    """The minimum over all processes that train together."""
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        values = values.clone()
        torch.distributed.all_reduce(values, torch.distributed.ReduceOp.MIN)
    return values
