"""Checkpoints from which a killed training run goes on."""

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

from deux.errors import DeuxError
from deux.io.arrays import said
from deux.io.atomic import make_folder, write_atomically

REQUEUE_CHECKPOINTS = "hpc_ckpt_*.ckpt"
"""What Lightning calls the checkpoint that it writes at a signal of Slurm's, in the middle of whatever it does."""


def resume_checkpoints(folder: Path, minutes: float) -> list[Callback]:
    """Callbacks that keep the state of the training in `folder`, to resume from after a kill.

    There is one checkpoint of the end of the last epoch and one of a step within an epoch, which is written when so
    many minutes have passed since the last one.

    Args:
        folder: takes the checkpoints.
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
    """Keeps the newest checkpoint of its kind, and none that a kill left behind.

    A process that is killed after it wrote a checkpoint and before it deleted the one before leaves both, and no later
    start knows of the older one. Files of one kind are those that `filename` may have named.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Delete what an earlier start left."""
        super().on_train_start(trainer, pl_module)
        self._delete_others(trainer)

    def _save_checkpoint(self, trainer: Trainer, filepath: str) -> None:
        super()._save_checkpoint(trainer, filepath)
        self._delete_others(trainer)
        if trainer.is_global_zero and self.dirpath:
            for path in Path(self.dirpath).parent.glob(REQUEUE_CHECKPOINTS):  # they are older now
                path.unlink(missing_ok=True)

    def _delete_others(self, trainer: Trainer) -> None:
        if trainer.is_global_zero and self.dirpath and self.best_model_path:
            names = re.sub(r"{(\w+)}", r"\1=*", str(self.filename)) + self.FILE_EXTENSION
            for path in Path(self.dirpath).glob(names):
                if path.name != Path(self.best_model_path).name:
                    path.unlink(missing_ok=True)


class EpochCheckpoints(NewestCheckpoint):
    """Checkpoints at the end of epochs, and the right place in the epochs for a run that resumes from any checkpoint.

    Order and augmentation of the samples follow from seed and epoch (`deux.data.shuffled_draws`), so a resumed
    run goes on as if it had never stopped. Two things are mended that Lightning (2.6) does otherwise:

    - From the end of an epoch, a run with `max_steps` takes the finished epoch for one that was cut short: it gives it
      one batch of the next epoch's, ends it for a second time and leaves out the rest.
    - Within the first epoch, the loader does not get its state where the number of batches was needed before, such as
      for the learning rate's schedule, and begins the epoch anew.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Go on after the epoch, or the batch, that the checkpoint was written after."""
        super().on_train_start(trainer, pl_module)
        loop = trainer.fit_loop
        if loop.restarted_on_epoch_end:
            loop.epoch_progress.increment_completed()
            loop.reset_restart_stage()
            loop.epoch_loop.restarting = False
        loop._load_combined_loader_states()  # does nothing where they are loaded

    def on_save_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """Let a step that is under way begin anew, as where a signal of Slurm's asks for a checkpoint in its middle.

        Otherwise its batch, or those before it whose gradients are accumulated, would be left out.
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
    """Checkpoints by time, each after a whole step of the optimiser.

    None is written between batches whose gradients are accumulated, since the sum is not part of it; nor after a batch
    that a validation or the end of the epoch follows, which a resumed run would leave out. The next batch brings it.
    """

    @property
    def state_key(self) -> str:
        """The same for any interval, so that a run may be resumed with another one."""
        return type(self).__name__

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Write a checkpoint if it is time."""
        loop = trainer.fit_loop
        assert loop._data_fetcher is not None
        validates = loop.epoch_loop._should_check_val_fx(loop._data_fetcher)
        if not (trainer.is_last_batch or validates or (batch_idx + 1) % trainer.accumulate_grad_batches):
            super().on_train_batch_end(trainer, pl_module, outputs, batch, batch_idx)


class AtomicCheckpoints(TorchCheckpointIO):
    """Writes checkpoints whole or not at all. Lightning's own writer leaves part of one on a full disk."""

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
    """The newest checkpoint of `folder` that loads, for `trainer.fit(ckpt_path=..., weights_only=True)`, or None.

    The run folder above it may hold one that Lightning writes as Slurm takes a job off a node (`REQUEUE_CHECKPOINTS`).
    A file that does not load, such as one that a failing disk damaged, is passed over with a warning.
    """
    requeued = {*folder.parent.glob(REQUEUE_CHECKPOINTS)}
    files = [path for path in (*folder.glob("*.ckpt"), *requeued) if path.is_file()]
    for path in sorted(files, key=lambda path: path.stat().st_mtime, reverse=True):
        try:
            content = torch.load(path, map_location="meta", weights_only=True, mmap=True)
            if not isinstance(content, dict) or not isinstance(content.get("state_dict"), dict):
                raise ValueError("it holds no state_dict")
        except Exception as error:  # a damaged file fails in many ways, depending on where it was cut
            rank_zero_warn(f"The checkpoint {path} cannot be read and is passed over: {said(error)}")
        else:
            if path not in requeued or not _ends_epoch(content):
                return path
    return None


def _ends_epoch(content: dict[str, Any]) -> bool:
    """Whether a checkpoint was written after an epoch's last batch: what ends the epoch would be left out."""
    try:
        progress = content["loops"]["fit_loop"]["epoch_loop.batch_progress"]
        return bool(progress["is_last_batch"] and progress["current"]["processed"] == progress["current"]["ready"])
    except (LookupError, TypeError):  # of another training, which is told when it is loaded
        return False


class ResumedFrom(Callback):
    """Says of which file a training could not take its state, where Lightning fails before the first step.

    Args:
        point: the checkpoint; None for a training that begins.
    """

    def __init__(self, point: Path | None) -> None:
        self.point = point
        self._begun = False

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """What fails from here on is not the checkpoint's."""
        self._begun = True

    @contextmanager
    def restoring(self) -> Iterator[None]:
        """Turn what a checkpoint of another training, or a damaged one, leads to into one sentence.

        Raises:
            DeuxError: the state could not be taken.
        """
        try:
            yield
        except (LookupError, TypeError, AttributeError, ValueError, RuntimeError) as error:
            if self._begun or self.point is None or isinstance(error, torch.OutOfMemoryError):
                raise
            cause = " ".join(said(error).split()[:40])
            raise DeuxError(
                f"{self.point} is damaged or of another training ({cause}): delete it to go on from the one before, or "
                "to train from the beginning."
            ) from error
