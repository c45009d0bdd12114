"""The LightningModule that trains a depth model, by default without ground truth."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import torch
from lightning.pytorch import LightningModule
from lightning.pytorch.plugins import MixedPrecision, Precision
from lightning.pytorch.utilities import GradClipAlgorithmType
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor
from torch.optim import Optimizer
from torchmetrics import Metric

from deux.contracts import Batch, DepthModel, Prediction
from deux.errors import DeuxError
from deux.geometry.photometric_residual import photometric_residual
from deux.geometry.sparse_outliers import remove_outliers
from deux.registry import registry
from deux.training.fused_adam import FusedAdam
from deux.training.graphed_step import GraphedStep, StepValues
from deux.training.objective import Losses, Objective
from deux.training.pose_source import PoseSource
from deux.training.schedule import Schedule
from deux.training.training_progress import training_progress


class DepthCompletion(LightningModule):
    """A depth model with its objective, its relative poses and its optimiser.

    The network runs in the trainer's precision and in channels-last layout; reconstructions, losses and metrics are
    float32. A step never synchronises host and device (`deux.testing.host_waits`), so that a GPU always has work
    queued; logged values are read every `log_every_n_steps` steps.

    The module saves no hyperparameters: to resume, it is made again from the configuration. Checkpoints contain only
    tensors and plain values, so that they load with `weights_only=True`.

    Args:
        model: the depth model to train.
        objective: computes the loss.
        pose_source: provides the relative poses; a learned one trains together with the model.
        schedule: the learning rate.
        metrics: updated with (predicted depth, ground truth) during validation, if frames come with ground truth; its
            `compute` returns a dictionary of scalars.
        cuda_graphs: record networks and losses as a CUDA graph in the first step on a GPU, and replay it from then on;
            only with a single process and without gradient accumulation.
        betas: Adam's decay rates of the running means of the gradient and of its square.
    """

    def __init__(
        self,
        model: DepthModel,
        objective: Objective,
        pose_source: PoseSource | None = None,
        schedule: Schedule | None = None,
        metrics: Metric | None = None,
        cuda_graphs: bool = False,
        betas: tuple[float, float] = (0.9, 0.999),
    ) -> None:
        super().__init__()
        self.model = model.to(memory_format=torch.channels_last)
        self.objective = objective
        self.pose_source = pose_source or PoseSource()
        self.schedule = schedule or Schedule()
        self.metrics = metrics
        self.cuda_graphs = cuda_graphs
        self.betas = betas
        self._graphed_step: GraphedStep | None = None

    def setup(self, stage: str) -> None:
        """Convert the networks to the trainer's precision.

        Lightning itself does so only after restoring a checkpoint, which would round float64 weights.
        """
        self.trainer.precision_plugin.convert_module(self)

    def on_train_start(self) -> None:
        """Use CUDA graphs from here on, if requested and possible."""
        trainer = self.trainer
        possible = self.device.type == "cuda" and trainer.world_size == 1 and trainer.accumulate_grad_batches == 1
        self._graphed_step = GraphedStep(self, self._step_values) if self.cuda_graphs and possible else None

    def on_train_end(self) -> None:
        """Free the graphs' memory."""
        if self._graphed_step is not None:
            self._graphed_step.free()
            self._graphed_step = None

    def forward(self, batch: Batch) -> Prediction:
        """Predict the depth of a batch's target frames."""
        return self.model(
            batch.image.contiguous(memory_format=torch.channels_last),
            batch.input_sparse_depth,
            batch.validity,
            batch.intrinsics,
            **batch.prepared,
        )

    def on_after_batch_transfer(self, batch: Batch, dataloader_idx: int) -> Batch:
        """Remove outliers from the validity map, once for the network and the losses."""
        return replace(batch, validity=batch.validity * remove_outliers(batch.sparse_depth))

    def training_step(self, batch: Batch, batch_idx: int) -> dict[str, Any]:
        """Compute the loss; also returns its terms and the mean predicted depth, for `deux.training.health`."""
        values = (self._graphed_step or self._step_values)(batch)
        self._log("train", values.logged, batch)
        # Created on the device: Lightning would copy a Python number there, and wait for the copy.
        rate = torch.full((), self.trainer.optimizers[0].param_groups[0]["lr"], device=batch.image.device)
        self.log("train/learning_rate", rate)
        terms = {name: values.logged[name] for name in self.objective.terms}
        return {"loss": values.total, "terms": terms, "mean_depth": values.mean_depth}

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Log the losses of a validation batch and update the metrics."""
        prediction, losses = self._losses(batch)
        self._log("validation", {"loss": losses.total, **losses.terms, **_photometric_error(batch, losses)}, batch)
        if self.metrics is not None and batch.ground_truth is not None:
            self.metrics.update(prediction.depth.float(), batch.ground_truth)

    def on_validation_epoch_end(self) -> None:
        """Log the metrics over all validation frames."""
        if self.metrics is not None and self.metrics.update_called:
            values = self.metrics.compute()
            self.log_dict({f"validation/{name}": value.float() for name, value in values.items()})
            self.metrics.reset()

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """Adam over all trainable parameters, with the schedule applied at every step."""
        parameters = [parameter for parameter in self.parameters() if parameter.requires_grad]
        if not parameters:
            raise DeuxError(
                f"{registry().called(self.model)} has no trainable parameters: a model that needs no training must "
                "declare `pretrained = True`, any other must keep its layers as attributes, with gradients."
            )
        # A gradient scaler leaves unscaling to a fused optimiser, but gradients must be unscaled before clipping.
        fused = not (self.trainer.gradient_clip_val and _scaler(self.trainer.precision_plugin))
        adam = FusedAdam if fused else torch.optim.Adam
        optimizer = adam(parameters, lr=self.schedule.learning_rate, betas=self.betas)

        # A function, not an object: LambdaLR would save an object's state in the checkpoint.
        def factor(step: int) -> float:
            # After the last batch of an epoch this is the factor of the next epoch's first step.
            fraction = training_progress(self.trainer).fraction
            return self.schedule.factor(step, fraction, self.current_epoch + self.trainer.is_last_batch)

        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, factor)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def configure_gradient_clipping(
        self,
        optimizer: Optimizer,
        gradient_clip_val: int | float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clip gradients as Lightning does, and also with a fused optimiser in bf16-mixed, which Lightning refuses.

        A fused optimiser unscales gradients itself, so that they would still be scaled here; but bfloat16 needs no
        scaling.
        """
        plugin = self.trainer.precision_plugin
        if gradient_clip_val and isinstance(plugin, MixedPrecision) and not _scaler(plugin):
            algorithm = GradClipAlgorithmType(gradient_clip_algorithm or GradClipAlgorithmType.NORM)
            Precision.clip_gradients(plugin, optimizer, gradient_clip_val, algorithm)
        else:
            self.clip_gradients(optimizer, gradient_clip_val, gradient_clip_algorithm)

    def _step_values(self, batch: Batch) -> StepValues:
        """Compute the loss and the logged values of a training step."""
        prediction, losses = self._losses(batch)
        self._check_trainable(prediction, losses)
        logged = {"loss": losses.total.detach(), **losses.terms, **_photometric_error(batch, losses)}
        return StepValues(losses.total, logged, prediction.depth.detach().float().mean())

    def _check_trainable(self, prediction: Prediction, losses: Losses) -> None:
        """Raise DeuxError if the loss has no gradient with respect to any weight."""
        if losses.total.requires_grad:
            return
        terms = " and ".join(self.objective.terms)
        cause = (
            f"none of the loss terms ({terms}) has one although the depth has: they detach it, or do not use the depth."
        )
        if not prediction.depth.requires_grad:
            cause = (
                "its depth has none: `forward` computes it without torch, detached, under no_grad, or without weights."
            )
        raise DeuxError(
            f"the loss of {registry().called(self.model)} has no gradient, so that nothing would be learned: {cause}"
        )

    def _losses(self, batch: Batch) -> tuple[Prediction, Losses]:
        prediction = self(batch)
        poses = None
        if self.objective.needs_reconstructions:
            poses = self.pose_source(batch, backward=self.objective.needs_backward_poses)
        return prediction, self.objective(batch, prediction, poses)

    def _log(self, stage: str, values: dict[str, Tensor], batch: Batch) -> None:
        for name, value in values.items():
            # Without prog_bar=True: Lightning would read the value at every step, even without a progress bar.
            self.log(f"{stage}/{name}", value, batch_size=len(batch.image))


def logged_quantities(objective: Objective, metrics: Iterable[str], validated: bool) -> list[str]:
    """The names of all quantities that a training logs, such as "validation/loss", for callbacks that monitor one.

    Args:
        objective: the training's objective.
        metrics: keys that `compute` of the module's metrics returns.
        validated: whether there are validation frames.
    """
    each = ["loss", *objective.terms, *(["photometric_error"] if objective.needs_reconstructions else [])]
    found = [f"train/{name}" for name in (*each, "learning_rate")]
    return found + ([f"validation/{name}" for name in (*each, *metrics)] if validated else [])


def _scaler(plugin: Precision) -> Any:
    """The gradient scaler (`trainer.precision=16-mixed`), or None."""
    return getattr(plugin, "scaler", None)


@torch.no_grad()
def _photometric_error(batch: Batch, losses: Losses) -> dict[str, Tensor]:
    """The residual of Eq. 8 averaged over the batch: comparable between objectives, unlike the loss."""
    if losses.reconstructions is None:
        return {}
    rebuilt = losses.reconstructions
    return {"photometric_error": photometric_residual(batch.image, rebuilt.images, rebuilt.visible).nanmean()}
