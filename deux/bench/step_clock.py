"""Lightning callbacks that measure training steps and their parts."""

from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer
from torch import nn

from deux.bench.timing import Stopwatch
from deux.training.module import DepthCompletion

PARTS = ("network", "poses", "objective", "backward", "optimiser")
"""Parts of a training step, in order. The rest of the step is logging and overhead of Lightning."""


class MeanStep(Callback):
    """Callback that measures the mean duration of all steps but the first, without synchronizing the GPU in between."""

    seconds: float
    """Mean duration of a step in seconds; set after the last step."""

    def __init__(self) -> None:
        self._watch = Stopwatch()

    def on_train_batch_end(self, trainer: Trainer, *_: Any) -> None:
        """Start the measurement after the first step and stop it after the last."""
        if trainer.global_step == 1:
            self._watch.start("steps")
        elif trainer.global_step == trainer.max_steps:
            self._watch.stop("steps")
            self.seconds = self._watch.total("steps") / (trainer.max_steps - 1)


class StepClock(Callback):
    """Callback that measures each training step and its parts.

    A step is measured from the end of the previous step to its own end.

    Args:
        warm_up: number of first steps that are excluded; at least 1, since the first step has no previous one.
        parts: whether the parts are measured; this synchronizes with the GPU at the start and end of each part.
    """

    def __init__(self, warm_up: int = 1, parts: bool = True) -> None:
        self._parts = parts
        self.watch = Stopwatch()
        self._warm_up = warm_up
        self._hooks: list[Any] = []

    @property
    def steps(self) -> list[float]:
        """Duration of each step in seconds."""
        return self.watch.durations["step"]

    @property
    def shares(self) -> dict[str, list[float]]:
        """Percentage of each step's duration by part, including "rest"."""
        # The poses are not computed for an objective that does not reconstruct frames.
        parts = {part: self.watch.durations[part] or [0.0] * len(self.steps) for part in PARTS}
        shares = {
            part: [100.0 * share / step for share, step in zip(durations, self.steps, strict=True)]
            for part, durations in parts.items()
        }
        shares["rest"] = [100.0 - sum(step) for step in zip(*shares.values(), strict=True)]
        return shares

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Add hooks to the modules of the parts."""
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
        """Start the measurement of the backward pass."""
        self._start("backward")

    def on_after_backward(self, *_: Any) -> None:
        """Stop the measurement of the backward pass."""
        self._stop("backward")

    def on_before_optimizer_step(self, *_: Any) -> None:
        """Start the measurement of the optimiser."""
        self._start("optimiser")

    def on_train_batch_end(self, trainer: Trainer, *_: Any) -> None:
        """Stop the measurement of the optimiser and of the step, and start that of the next step."""
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
