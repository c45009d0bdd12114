"""Checkpoints from which a killed training resumes."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.plugins.io import TorchCheckpointIO
from lightning.pytorch.utilities import rank_zero_warn

from deux.errors import DeuxError, error_text
from deux.io.atomic import make_folder, write_atomically

REQUEUE_CHECKPOINTS = "hpc_ckpt_*.ckpt"
"""Files that Lightning writes when Slurm signals that a job will be preempted, possibly in the middle of a step."""


def resume_checkpoints(folder: Path, minutes: float) -> list[Callback]:
    """Callbacks that save checkpoints in `folder`, to resume from after a kill.

    Two are kept: one of the end of the last epoch, and one within an epoch, written at intervals of time.

    Args:
        folder: folder of the checkpoints.
        minutes: time between two checkpoints within an epoch.
    """
    return [
        EpochCheckpoints(
            dirpath=folder,
            filename="{epoch}-{step}",
            every_n_epochs=1,
            save_top_k=1,
            save_on_train_epoch_end=True,
        ),
        TimedCheckpoints(
            dirpath=folder,
            filename="within-{epoch}-{step}",
            train_time_interval=timedelta(minutes=minutes),
            save_top_k=1,
            save_on_train_epoch_end=False,
        ),
    ]


class NewestCheckpoint(ModelCheckpoint):
    """Keeps only the newest checkpoint whose name matches `filename`.

    A process that is killed between writing a checkpoint and deleting the previous one leaves both, and Lightning does
    not delete the older one when the training resumes.
    """

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the state with the present folder: Lightning warns if a run folder was moved since."""
        if (newest := state_dict["best_model_path"]) and self.dirpath:
            newest = str(Path(self.dirpath, Path(newest).name))
        super().load_state_dict({**state_dict, "dirpath": self.dirpath, "best_model_path": newest})

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Delete older checkpoints that a killed process left."""
        super().on_train_start(trainer, pl_module)
        self._delete_others(trainer)

    def _save_checkpoint(self, trainer: Trainer, filepath: str) -> None:
        super()._save_checkpoint(trainer, filepath)
        self._delete_others(trainer)
        if trainer.is_global_zero and self.dirpath:
            for path in Path(self.dirpath).parent.glob(REQUEUE_CHECKPOINTS):  # older than this one
                path.unlink(missing_ok=True)

    def _delete_others(self, trainer: Trainer) -> None:
        if trainer.is_global_zero and self.dirpath and self.best_model_path:
            names = re.sub(r"{(\w+)}", r"\1=*", str(self.filename)) + self.FILE_EXTENSION
            for path in Path(self.dirpath).glob(names):
                if path.name != Path(self.best_model_path).name:
                    path.unlink(missing_ok=True)


class EpochCheckpoints(NewestCheckpoint):
    """Checkpoints at the end of epochs; also restores the position within epochs when resuming from any checkpoint.

    Order and augmentation of the samples are determined by seed and epoch (`deux.data.shuffled_draws`), so that a
    resumed training is identical to an uninterrupted one. This corrects two faults of Lightning 2.6:

    - Resuming from the end of an epoch with `max_steps`, it treats the finished epoch as interrupted: it runs one batch
      of the next epoch as part of it, ends it a second time and skips the rest.
    - Resuming within the first epoch, it does not restore the data loader's state if the number of batches was needed
      before, such as by the learning rate schedule, and starts the epoch again.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Continue after the epoch or batch at which the checkpoint was written."""
        super().on_train_start(trainer, pl_module)
        loop = trainer.fit_loop
        if loop.restarted_on_epoch_end:
            loop.epoch_progress.increment_completed()
            loop.reset_restart_stage()
            loop.epoch_loop.restarting = False
        loop._load_combined_loader_states()  # has no effect if they are already loaded

    def on_save_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """In a checkpoint written during a step, such as at Slurm's signal, rewind to the beginning of the step.

        Otherwise, the step's batches, whose gradients are lost, would be skipped.
        """
        progress = trainer.fit_loop.epoch_loop.batch_progress
        current: Any = progress.current
        done = current.processed - current.processed % trainer.accumulate_grad_batches
        if done == current.ready or (progress.is_last_batch and current.processed == current.ready):
            return
        state = checkpoint["loops"]["fit_loop"]
        kept = state["epoch_loop.batch_progress"]
        for count, batches in kept["current"].items():
            kept["total"][count] -= batches - done
            kept["current"][count] = done
        for loader in filter(None, state["state_dict"].get("combined_loader", ())):
            loader["items"] = done * trainer.train_dataloader.batch_size  # type: ignore[union-attr]


class TimedCheckpoints(NewestCheckpoint):
    """Checkpoints at intervals of time, each after a complete optimiser step.

    None is written between batches whose gradients are accumulated, since checkpoints do not contain gradients; nor
    before a validation or the end of an epoch, which a resumed training would skip. It is then written later.
    """

    @property
    def state_key(self) -> str:
        """Independent of the interval, so that a training can be resumed with another one."""
        return type(self).__name__

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Write a checkpoint if one is due."""
        loop = trainer.fit_loop
        assert loop._data_fetcher is not None
        validates = loop.epoch_loop._should_check_val_fx(loop._data_fetcher)
        if not (trainer.is_last_batch or validates or (batch_idx + 1) % trainer.accumulate_grad_batches):
            super().on_train_batch_end(trainer, pl_module, outputs, batch, batch_idx)


class AtomicCheckpoints(TorchCheckpointIO):
    """Writes checkpoints atomically; on a full disk, Lightning's own writer leaves a truncated file."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None) -> None:
        """Write a checkpoint.

        Raises:
            DeuxError: the file cannot be written, such as on a full disk.
        """
        content = io.BytesIO()
        torch.save(checkpoint, content)
        make_folder(Path(path).parent)
        write_atomically(Path(path), content.getvalue())


def resume_point(folder: Path) -> Path | None:
    """The newest readable checkpoint of `folder`, for `trainer.fit(ckpt_path=..., weights_only=True)`, or None.

    This includes checkpoints that Lightning wrote to the run folder above it (`REQUEUE_CHECKPOINTS`). Files that cannot
    be read are skipped with a warning.
    """
    requeued = {*folder.parent.glob(REQUEUE_CHECKPOINTS)}
    files = [path for path in (*folder.glob("*.ckpt"), *requeued) if path.is_file()]
    for path in sorted(files, key=lambda path: path.stat().st_mtime, reverse=True):
        try:
            content = torch.load(path, map_location="meta", weights_only=True, mmap=True)
            if not isinstance(content, dict) or not isinstance(content.get("state_dict"), dict):
                raise ValueError("it holds no state_dict")
        except Exception as error:  # a damaged file raises errors of many kinds
            rank_zero_warn(f"The checkpoint {path} cannot be read and is passed over: {error_text(error)}")
        else:
            if path not in requeued or not _ends_epoch(content):
                return path
    return None


def _ends_epoch(content: dict[str, Any]) -> bool:
    """Whether a checkpoint was written after an epoch's last batch: resuming from it would skip the epoch's end."""
    try:
        progress = content["loops"]["fit_loop"]["epoch_loop.batch_progress"]
        return bool(progress["is_last_batch"] and progress["current"]["processed"] == progress["current"]["ready"])
    except (LookupError, TypeError):  # of another training, which is reported when it is loaded
        return False


class ResumedFrom(Callback):
    """Reports the checkpoint's file if Lightning fails to restore it.

    Args:
        point: the checkpoint; None for a new training.
    """

    def __init__(self, point: Path | None) -> None:
        self.point = point
        self._begun = False

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Later errors are not caused by the checkpoint."""
        self._begun = True

    @contextmanager
    def restoring(self) -> Iterator[None]:
        """Turn errors from restoring a damaged checkpoint, or that of another training, into a DeuxError.

        Raises:
            DeuxError: the state could not be restored.
        """
        try:
            yield
        except (LookupError, TypeError, AttributeError, ValueError, RuntimeError) as error:
            if self._begun or self.point is None or isinstance(error, torch.OutOfMemoryError):
                raise
            cause = " ".join(error_text(error).split()[:40])
            raise DeuxError(
                f"{self.point} is damaged or of another training ({cause}): delete it to resume from the one before "
                "it, or to train from the beginning."
            ) from error
