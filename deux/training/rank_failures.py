"""Processes that train one model together end together: the failure of one is told to all, with its sentence.

Without it a process waits for one that has failed: for half an hour with NCCL, or it ends by a stack trace of gloo's.
"""

import atexit

from lightning.pytorch import Callback, LightningModule, Trainer

from deux.errors import DeuxError
from deux.training.rank_watch import RankWatch
from deux.training.ranks import connect_store

_watch: RankWatch | None = None


class EndTogether(Callback):
    """Begins to watch the other processes when a training with several begins; it goes on until this process ends."""

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Begin, unless there is only one process or it watches already."""
        global _watch
        if trainer.world_size > 1 and _watch is None and (store := connect_store()) is not None:
            _watch = RankWatch(store, trainer.global_rank, trainer.world_size)
            _watch.start()
            atexit.register(_watch.stop)

    def on_exception(self, trainer: Trainer, pl_module: LightningModule, exception: BaseException) -> None:
        """Remember that a training failed or was interrupted here: its other processes may wait for this one."""
        if _watch is not None:
            _watch.failed = True


def told_to_all(error: BaseException, sentence: str) -> DeuxError | None:
    """Tell the other processes of this one's failure, or find that it failed because another one did.

    Args:
        error: by which this process ends.
        sentence: what the others are told.

    Returns:
        The error of the other process that came first; None if this one's is the first, or it is alone.
    """
    return None if _watch is None else _watch.fail(error, sentence)
