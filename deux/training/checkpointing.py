"""Checkpoints from which a killed training run goes on."""

from pathlib import Path

import torch
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.utilities import rank_zero_warn


def resume_checkpoints(folder: Path) -> ModelCheckpoint:
    """A callback that keeps the state at the end of the last epoch in `folder`, to resume from.

    Epochs are the grain because a data loader cannot go on within one: from an epoch's end, a run whose shuffling
    follows from seed and epoch goes on exactly as if it had never stopped.
    """
    return ModelCheckpoint(
        dirpath=folder,
        filename="{epoch}-{step}",
        every_n_epochs=1,
        save_top_k=1,
        save_on_train_epoch_end=True,
    )


def resume_point(folder: Path) -> Path | None:
    """The newest checkpoint in `folder` that loads, for `trainer.fit(ckpt_path=..., weights_only=True)`, or None.

    A file that does not load, such as one cut short by a full disk, is passed over with a warning.
    """
    for path in sorted(folder.glob("*.ckpt"), key=lambda path: path.stat().st_mtime, reverse=True):
        try:
            torch.load(path, map_location="meta", weights_only=True, mmap=True)
        except Exception as error:  # a damaged file fails in many ways, depending on where it was cut
            rank_zero_warn(f"The checkpoint {path} cannot be read and is passed over: {error}")
        else:
            return path
    return None
