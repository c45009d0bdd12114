"""Trains a depth model on datasets, from the beginning or from the last checkpoint of a killed training."""

import logging
import math
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, Trainer, seed_everything
from lightning.pytorch import LightningModule
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from torch import nn
from torchmetrics import Metric

from deux.callbacks import lightning_object
from deux.contracts import DepthModel, Reader
from deux.data.cache_choice import CacheChoice
from deux.data.datamodule import TripletDataModule
from deux.errors import DeuxError
from deux.inference.precision import default_precision, tf32_convolutions
from deux.training.checkpointing import AtomicCheckpoints, ResumedFrom, resume_checkpoints, resume_point
from deux.training.health import HealthCheck
from deux.training.module import DepthCompletion
from deux.training.network_compilation import compiled_networks
from deux.training.network_precision import network_precision
from deux.training.objective import Objective, make_objective
from deux.training.pose_source import PoseKind, make_pose_source
from deux.training.rank_failures import EndTogether
from deux.training.training_settings import TrainingSettings
from deux.training.weight_averaging import TailAveraging, check_end, check_one_mean

log = logging.getLogger(__name__)


def fit(
    model: DepthModel,
    settings: TrainingSettings,
    train: Sequence[Reader],
    validation: Sequence[Reader],
    folder: Path,
    objective: Mapping[str, Any] | None = None,
    pose: PoseKind = "simulator",
    seed: int = 0,
    metrics: Metric | None = None,
    trainer_arguments: Mapping[str, Any] | None = None,
    callbacks: Sequence[Callback] = (),
    cache: CacheChoice = "auto",
) -> DepthModel:
    """Train `model` in place and return it, in eval mode.

    Args:
        model: a new model; its weights are replaced if there is a checkpoint to resume from.
        settings: budget and learning rate.
        train: readers of the datasets to train on.
        validation: readers of the datasets to validate on; may be empty.
        folder: for `checkpoints/` and `logs/`. If it contains checkpoints, training resumes from the last one.
        objective: loss terms that override the model's own.
        pose: source of the relative poses.
        seed: random seed of order, crops and augmentation.
        metrics: updated with (predicted depth, ground truth) in validation.
        trainer_arguments: further arguments of Lightning's Trainer.
        callbacks: further callbacks.
        cache: where frames are cached; it does not affect the weights.

    Raises:
        DeuxError: an option is wrong, a dataset is broken, or the loss is not finite.
    """
    check_one_mean(settings.averaging, callbacks)
    seed_everything(seed, workers=True, verbose=False)
    terms = make_objective(model, objective, model.supervised or settings.supervised)
    data = _data_module(model, train, validation, settings, terms, pose, seed, cache)
    poses, graphed = make_pose_source(pose, model), _graphed(settings)
    module = DepthCompletion(model, terms, poses, settings, metrics, graphed, settings.betas)
    checkpoints, own = folder / "checkpoints", trainer_arguments or {}
    resumed = ResumedFrom(resume_point(checkpoints))
    trainer = make_trainer(
        {
            **_trainer_defaults(folder, bool(validation), own.get("accelerator", "auto")),
            "callbacks": [resumed, *_own_callbacks(checkpoints, settings, own), *callbacks],
            **_budget(settings, own),
            **own,
        }
    )
    log.info(_hardware_and_precision(trainer, settings))
    with (
        _interruptible(),
        tf32_convolutions(settings.tf32),
        compiled_networks(_compilable(module, pose, trainer.strategy.root_device), settings.compile),
        resumed.restoring(),
        _fitting_intervals(),
    ):
        trainer.fit(module, datamodule=data, ckpt_path=resumed.point, weights_only=True)
    return model.eval()


def check_trainer(settings: TrainingSettings, trainer_arguments: Mapping[str, Any]) -> Trainer:
    """Create the trainer of `fit` without loggers and callbacks, to find mistakes before any work is done.

    Args:
        settings: as for `fit`.
        trainer_arguments: as for `fit`.

    Raises:
        DeuxError: an argument is unknown or invalid, or contradicts what a training needs.
    """
    if trainer_arguments.get("enable_checkpointing") is False:
        raise DeuxError(
            "trainer.enable_checkpointing=false would leave a training that is killed nothing to resume from: leave it "
            "true; only the newest checkpoints are kept."
        )
    if given := sorted({"callbacks", "plugins"} & trainer_arguments.keys()):
        raise DeuxError(
            f"trainer.{given[0]} takes objects, which no option can be, and would replace those that save the "
            "training's checkpoints: callbacks=[early_stopping] chooses callbacks by name."
        )
    own = {"logger": False, "enable_checkpointing": False, **trainer_arguments}
    trainer = make_trainer({**_budget(settings, trainer_arguments), **own})
    if settings.averaging:
        check_end(trainer, settings.averaging)
    return trainer


def make_trainer(arguments: Mapping[str, Any]) -> Trainer:
    """Create Lightning's Trainer.

    Raises:
        DeuxError: an argument is unknown, or its value is invalid.
    """
    if (plugin := network_precision(arguments.get("precision"))) is not None:
        others = {name: value for name, value in arguments.items() if name != "precision"}
        arguments = {**others, "plugins": [*(arguments.get("plugins") or []), plugin]}
    return lightning_object(Trainer, arguments, "trainer")


def _data_module(
    model: DepthModel,
    train: Sequence[Reader],
    validation: Sequence[Reader],
    settings: TrainingSettings,
    terms: Objective,
    pose: PoseKind,
    seed: int,
    cache: CacheChoice,
) -> TripletDataModule:
    """The data module of a training, which reads only what the objective needs of each frame."""
    return TripletDataModule(
        model,
        train,
        validation,
        batch_size=settings.batch_size,
        crop=settings.crop,
        seed=seed,
        num_workers=settings.num_workers,
        cache=cache,
        offsets=settings.offsets,
        choice=settings.sources,
        sources=terms.needs_reconstructions,
        poses=terms.needs_reconstructions and pose == "simulator",
        supervised=model.supervised or settings.supervised,
        augmentation=settings.augmentation,
    )


@contextmanager
def _interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on Ctrl-C: Lightning turns it into SystemExit, and ignores SIGINT from then on."""
    try:
        yield
    except SystemExit as ended:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        raise KeyboardInterrupt from ended


@contextmanager
def _fitting_intervals() -> Iterator[None]:
    """Turn Lightning's error about a `val_check_interval` longer than an epoch into a DeuxError."""
    try:
        yield
    except ValueError as error:
        if "`val_check_interval`" not in str(error):
            raise
        raise DeuxError(
            "trainer.val_check_interval is more batches than an epoch has, and with trainer.check_val_every_n_epoch "
            "they are counted within epochs: set trainer.check_val_every_n_epoch=null to count them across epochs."
        ) from error


class EvenValidations(Callback):
    """Spreads validations evenly over a training with gradient accumulation, where Lightning counts batches, not steps.

    Args:
        steps: optimiser steps of the training.
        validations: number of validations.
    """

    def __init__(self, steps: int, validations: int) -> None:
        self._steps, self._validations = steps, validations
        self._interval = 0

    def state_dict(self) -> dict[str, Any]:
        """The interval in batches, which a resumed training keeps even if its epochs have become longer."""
        return {"interval": self._interval}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the interval."""
        self._interval = state_dict["interval"]

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Set the interval; an epoch's last step may accumulate fewer batches than the others."""
        batches = int(trainer.num_training_batches)
        steps = math.ceil(batches / trainer.accumulate_grad_batches)
        self._interval = self._interval or max(1, self._steps * batches // (steps * self._validations))
        trainer.val_check_interval = trainer.val_check_batch = self._interval


def _compilable(module: DepthCompletion, pose: PoseKind, device: torch.device) -> list[nn.Module]:
    """The modules that `training.compile` applies to."""
    learned = [module.pose_source] if pose == "learned" else []
    # On a CPU, compiling the objective fails (PyTorch 2.14), and its SSIM is compiled by numba.
    return [module.model, *learned, *([module.objective] if device.type == "cuda" else [])]


def _graphed(settings: TrainingSettings) -> bool:
    """Whether to record steps as CUDA graphs: not if `torch.compile` records graphs itself."""
    return settings.cuda_graphs and settings.compile in (False, True, "default")


def _hardware_and_precision(trainer: Trainer, settings: TrainingSettings) -> str:
    """Devices, precision and compilation of a training, for the log."""
    device = trainer.strategy.root_device
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else device.type.upper()
    tf32 = "in TensorFloat-32" if settings.tf32 else "exact"
    mode = "default" if settings.compile is True else settings.compile
    return (
        f"training on {trainer.world_size} x {name} with precision {trainer.precision}, float32 convolutions {tf32}, "
        f"{f'compiled ({mode})' if mode else 'not compiled'}"
    )


def _trainer_defaults(folder: Path, validate: bool, accelerator: str) -> dict[str, Any]:
    """Default arguments of the trainer, which the user's override."""
    version = f"version_{len(list((folder / 'logs').glob('version_*')))}"
    return {
        "precision": default_precision(accelerator),
        "default_root_dir": folder,  # for the checkpoint that Lightning writes and reads when Slurm requeues a job
        "logger": [logger(folder, "logs", version) for logger in (CSVLogger, TensorBoardLogger)],
        "plugins": [AtomicCheckpoints()],
        "enable_model_summary": False,
        "num_sanity_val_steps": 0,
        "limit_val_batches": 1.0 if validate else 0,
        "use_distributed_sampler": False,  # the data module distributes frames and their augmentation
        # The loader then rereads the list files and finds frames that were added in the meantime.
        "reload_dataloaders_every_n_epochs": 1,
    }


def _own_callbacks(checkpoints: Path, settings: TrainingSettings, own: Mapping[str, Any]) -> list[Callback]:
    """The callbacks of every training; `own` are the user's arguments of the trainer."""
    found = [*resume_checkpoints(checkpoints, settings.checkpoint_minutes), HealthCheck(), EndTogether()]
    accumulates = own.get("accumulate_grad_batches", 1) != 1
    validates_as_asked = {"val_check_interval", "check_val_every_n_epoch"} & own.keys()
    if settings.steps is not None and accumulates and not validates_as_asked:
        found.append(EvenValidations(settings.steps, settings.validations))
    if settings.averaging:
        found.append(TailAveraging(settings.averaging))
    return found


def _budget(settings: TrainingSettings, own: Mapping[str, Any]) -> dict[str, Any]:
    """The trainer's arguments for the length of the training, logging and validation.

    Those for validation are left out if the user sets them: Lightning counts the batches between validations either
    within epochs or across them, and refuses a mixture.
    """
    if settings.steps is None:
        budget = {"max_epochs": settings.epochs, "log_every_n_steps": 10}
        validations = {"check_val_every_n_epoch": max(1, settings.epochs // settings.validations)}
        return budget | ({} if "val_check_interval" in own else validations)
    budget = {"max_steps": settings.steps, "log_every_n_steps": max(1, min(10, settings.steps // 20))}
    if own.get("check_val_every_n_epoch") is not None or isinstance(own.get("val_check_interval"), float):
        return budget  # validates after epochs, or after fractions of one
    interval = max(1, settings.steps // settings.validations)
    # None counts batches across epochs.
    return {**budget, "val_check_interval": interval, "check_val_every_n_epoch": None}
