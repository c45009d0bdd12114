"""Timing of the parts of a training step."""

from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer
from torch import nn

from deux.bench.timing import Stopwatch
from deux.training.module import DepthCompletion

PARTS = ("network", "poses", "objective", "backward", "optimiser")
"""The parts of a step, in their order; what is left over is logging and Lightning itself."""


class MeanStep(Callback):
    """Times all steps of a `Trainer` but the first as a whole, so that a card is not waited for between two of them."""

    seconds: float
    """Of one step; known after the last."""

    def __init__(self) -> None:
        self._watch = Stopwatch()

    def on_train_batch_end(self, trainer: Trainer, *_: Any) -> None:
        """Begin after the first step, end after the last."""
        if trainer.global_step == 1:
            self._watch.start("steps")
        elif trainer.global_step == trainer.max_steps:
            self._watch.stop("steps")
            self.seconds = self._watch.total("steps") / (trainer.max_steps - 1)


class StepClock(Callback):
    """Times each step of a `Trainer` and its parts. A step lasts from the end of the one before it to its own end.

    Args:
        warm_up: first steps that are not counted; at least 1, for the first has no beginning.
        parts: whether the parts are timed as well; a card then has to be waited for at the end of each.
    """

    def __init__(self, warm_up: int = 1, parts: bool = True) -> None:
        self._parts = parts
        self.watch = Stopwatch()
        self._warm_up = warm_up
        self._hooks: list[Any] = []

    @property
    def steps(self) -> list[float]:
        """Seconds of each step."""
        return self.watch.durations["step"]

    @property
    def shares(self) -> dict[str, list[float]]:
        """Percentage of its step that each part took, and the rest."""
        # An objective that compares no frames asks for no poses.
        parts = {part: self.watch.durations[part] or [0.0] * len(self.steps) for part in PARTS}
        shares = {
            part: [100.0 * share / step for share, step in zip(durations, self.steps, strict=True)]
            for part, durations in parts.items()
        }
        shares["rest"] = [100.0 - sum(step) for step in zip(*shares.values(), strict=True)]
        return shares

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Add hooks to the modules that a step calls."""
        assert isinstance(pl_module, DepthCompletion)
        if not self._parts:
            return
        modules: dict[str, nn.Module] = {
            "network": pl_module.model,
            "poses": pl_module.pose_source,
            "objective": pl_module.objective,
        }
        for part, module in modules.items():
            self._hooks.append(module.register_forward_pre_hook(lambda *_, part=part: self.watch.start(part)))
            self._hooks.append(module.register_forward_hook(lambda *_, part=part: self.watch.stop(part)))

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Remove the hooks."""
        for hook in self._hooks:
            hook.remove()

    def on_before_backward(self, *_: Any) -> None:
        """The forward pass has ended."""
        self._start("backward")

    def on_after_backward(self, *_: Any) -> None:
        """The backward pass has ended."""
        self._stop("backward")

    def on_before_optimizer_step(self, *_: Any) -> None:
        """The optimiser step starts."""
        self._start("optimiser")

    def on_train_batch_end(self, trainer: Trainer, *_: Any) -> None:
        """The optimiser step has ended."""
        self._stop("optimiser")
        if trainer.global_step > self._warm_up:
            self.watch.stop("step")
        elif trainer.global_step == self._warm_up:
            self.watch.durations.clear()
        self.watch.start("step")

    def _start(self, part: str) -> None:
        if self._parts:
            self.watch.start(part)

    def _stop(self, part: str) -> None:
        if self._parts:
            self.watch.stop(part)
