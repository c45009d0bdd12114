"""Checkpoints from which a killed training run goes on."""

import io
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.plugins.io import TorchCheckpointIO
from lightning.pytorch.utilities import rank_zero_warn

from deux.io.atomic import make_folder, write_atomically


def resume_checkpoints(folder: Path) -> ModelCheckpoint:
    """A callback that keeps the state at the end of the last epoch in `folder`, to resume from.

    Epochs are the grain because a data loader cannot go on within one: from an epoch's end, a run whose shuffling
    follows from seed and epoch goes on exactly as if it had never stopped.
    """
    return EpochCheckpoints(
        dirpath=folder,
        filename="{epoch}-{step}",
        every_n_epochs=1,
        save_top_k=1,
        save_on_train_epoch_end=True,
    )


class EpochCheckpoints(ModelCheckpoint):
    """Checkpoints at the end of epochs, after which a resumed run begins the next epoch, whole.

    Lightning does so itself where a run is measured in epochs. With `max_steps` it takes the finished epoch for one
    that was cut short: it gives it one batch of the next epoch's, ends it for a second time and leaves out the rest.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Count the epoch from whose end the run goes on as done."""
        super().on_train_start(trainer, pl_module)
        loop = trainer.fit_loop
        if loop.restarted_on_epoch_end:
            loop.epoch_progress.increment_completed()
            loop.reset_restart_stage()
            loop.epoch_loop.restarting = False


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
    """The newest checkpoint in `folder` that loads, for `trainer.fit(ckpt_path=..., weights_only=True)`, or None.

    A file that does not load, such as one that a failing disk damaged, is passed over with a warning.
    """
    for path in sorted(folder.glob("*.ckpt"), key=lambda path: path.stat().st_mtime, reverse=True):
        try:
            torch.load(path, map_location="meta", weights_only=True, mmap=True)
        except Exception as error:  # a damaged file fails in many ways, depending on where it was cut
            rank_zero_warn(f"The checkpoint {path} cannot be read and is passed over: {error}")
        else:
            return path
    return None
