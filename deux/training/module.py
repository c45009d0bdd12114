"""Training a depth model without ground truth, as a LightningModule."""

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
    float32. Nothing in a step makes the host wait for the device (`deux.testing.host_waits`), so that it runs ahead and
    a card always has work; what is logged is read every `log_every_n_steps` steps.

    The module saves no hyperparameters: whoever resumes makes it anew from the configuration, and a checkpoint holds
    nothing but tensors and plain values, so that it loads with `weights_only=True`.

    Args:
        model: the depth model to train.
        objective: compares its predictions with the frames.
        pose_source: gives the relative poses; a learned one trains together with the model.
        schedule: the learning rate.
        metrics: updated with (predicted depth, ground truth) during validation, if frames come with ground truth; its
            `compute` returns a dictionary of scalars.
        cuda_graphs: record networks and losses as a CUDA graph in the first step on a card, and replay it from then on;
            only where one process trains and gradients of several batches are not added up.
        betas: Adam's, of the running means of the gradient and of its square.
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

        Lightning does so only after it has restored a checkpoint, which would round float64 weights.
        """
        self.trainer.precision_plugin.convert_module(self)

    def on_train_start(self) -> None:
        """Have the steps replayed from here on, if that is asked for and possible."""
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
        """Take the outliers out of the validity, once, for the network and the losses alike."""
        return replace(batch, validity=batch.validity * remove_outliers(batch.sparse_depth))

    def training_step(self, batch: Batch, batch_idx: int) -> dict[str, Any]:
        """One step; also returns the loss terms and the mean predicted depth, for `deux.training.health`."""
        values = (self._graphed_step or self._step_values)(batch)
        self._log("train", values.logged, batch)
        # Filled in on the device: Lightning would copy the number there, and wait until it is there.
        rate = torch.full((), self.trainer.optimizers[0].param_groups[0]["lr"], device=batch.image.device)
        self.log("train/learning_rate", rate)
        terms = {name: values.logged[name] for name in self.objective.terms}
        return {"loss": values.total, "terms": terms, "mean_depth": values.mean_depth}

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Log the losses of held-out frames and count them in the metrics."""
        prediction, losses = self._losses(batch)
        self._log("validation", {"loss": losses.total, **losses.terms, **_photometric_error(batch, losses)}, batch)
        if self.metrics is not None and batch.ground_truth is not None:
            self.metrics.update(prediction.depth.float(), batch.ground_truth)

    def on_validation_epoch_end(self) -> None:
        """Log the metrics over all held-out frames."""
        if self.metrics is not None and self.metrics.update_called:
            values = self.metrics.compute()
            self.log_dict({f"validation/{name}": value.float() for name, value in values.items()})
            self.metrics.reset()

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """Adam over everything that trains, with the schedule applied at every step."""
        parameters = [parameter for parameter in self.parameters() if parameter.requires_grad]
        if not parameters:
            raise DeuxError(
                f"{registry().called(self.model)} has no parameters that can be trained: a model that needs no "
                "training says so by `pretrained = True`, any other keeps its layers as attributes, with gradients."
            )
        # A scaler leaves it to a fused optimiser to undo the scaling, which has to come before the clipping.
        fused = not (self.trainer.gradient_clip_val and _scaler(self.trainer.precision_plugin))
        adam = FusedAdam if fused else torch.optim.Adam
        optimizer = adam(parameters, lr=self.schedule.learning_rate, betas=self.betas)

        # A function and not an object: LambdaLR would put an object's state into the checkpoint.
        def factor(step: int) -> float:
            # After the last batch of an epoch this is the factor of the next epoch's first step.
            done, steps = training_progress(self.trainer)
            return self.schedule.factor(step, done / steps, self.current_epoch + self.trainer.is_last_batch)

        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, factor)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def configure_gradient_clipping(
        self,
        optimizer: Optimizer,
        gradient_clip_val: int | float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clip the gradients as Lightning does, and those of a fused optimiser in bf16-mixed as well.

        Lightning refuses the latter on the ground that a fused optimiser undoes the scaling of the loss by itself, so
        that the gradients are still scaled here. With bfloat16 there is no scaling.
        """
        plugin = self.trainer.precision_plugin
        if gradient_clip_val and isinstance(plugin, MixedPrecision) and not _scaler(plugin):
            algorithm = GradClipAlgorithmType(gradient_clip_algorithm or GradClipAlgorithmType.NORM)
            Precision.clip_gradients(plugin, optimizer, gradient_clip_val, algorithm)
        else:
            self.clip_gradients(optimizer, gradient_clip_val, gradient_clip_algorithm)

    def _step_values(self, batch: Batch) -> StepValues:
        """What a training step computes before its backward pass."""
        prediction, losses = self._losses(batch)
        self._check_trainable(prediction, losses)
        logged = {"loss": losses.total.detach(), **losses.terms, **_photometric_error(batch, losses)}
        return StepValues(losses.total, logged, prediction.depth.detach().float().mean())

    def _check_trainable(self, prediction: Prediction, losses: Losses) -> None:
        """Raise DeuxError if no gradient can reach a weight from the loss."""
        if losses.total.requires_grad:
            return
        terms = " and ".join(self.objective.terms)
        cause = (
            f"none of the loss terms ({terms}) has one, though the depth has: they lose it, or do not read the depth."
        )
        if not prediction.depth.requires_grad:
            cause = (
                "its depth has none: `forward` computes it without torch, detached, under no_grad, or from no weight."
            )
        raise DeuxError(
            f"the loss of {registry().called(self.model)} has no gradient, so that nothing is learned: {cause}"
        )

    def _losses(self, batch: Batch) -> tuple[Prediction, Losses]:
        prediction = self(batch)
        poses = None
        if self.objective.needs_reconstructions:
            poses = self.pose_source(batch, backward=self.objective.needs_backward_poses)
        return prediction, self.objective(batch, prediction, poses)

    def _log(self, stage: str, values: dict[str, Tensor], batch: Batch) -> None:
        for name, value in values.items():
            # Not for the progress bar: Lightning reads such values at every step, whether there is a bar or not.
            self.log(f"{stage}/{name}", value, batch_size=len(batch.image))


def logged_quantities(objective: Objective, metrics: Iterable[str], validated: bool) -> list[str]:
    """The names of all that a training logs of its own, such as "validation/loss", for callbacks that watch one.

    Args:
        objective: of the training.
        metrics: what `compute` of the module's metrics returns.
        validated: whether there are frames to validate on.
    """
    each = ["loss", *objective.terms, *(["photometric_error"] if objective.needs_reconstructions else [])]
    found = [f"train/{name}" for name in (*each, "learning_rate")]
    return found + ([f"validation/{name}" for name in (*each, *metrics)] if validated else [])


def _scaler(plugin: Precision) -> Any:
    """What scales the loss (`trainer.precision=16-mixed`); None where nothing does."""
    return getattr(plugin, "scaler", None)


@torch.no_grad()
def _photometric_error(batch: Batch, losses: Losses) -> dict[str, Tensor]:
    """The residual of Eq. 8 averaged over the batch: comparable between objectives, unlike the loss."""
    if losses.reconstructions is None:
        return {}
    rebuilt = losses.reconstructions
    return {"photometric_error": photometric_residual(batch.image, rebuilt.images, rebuilt.visible).nanmean()}
