"""Ends all processes of a distributed training if one of them fails, and reports that failure in each.

Otherwise, NCCL waits half an hour for a process that has failed, and gloo ends with a stack trace.
"""

import atexit

from lightning.pytorch import Callback, LightningModule, Trainer

from deux.errors import DeuxError
from deux.training.rank_watch import RankWatch
from deux.training.ranks import connect_store

_watch: RankWatch | None = None


class EndTogether(Callback):
    """Starts to watch the other processes when a distributed training begins, until this process ends."""

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Start the watch, unless there is only one process or it is running."""
        global _watch
        if trainer.world_size > 1 and _watch is None and (store := connect_store()) is not None:
            children = getattr(trainer.strategy.launcher, "procs", ())
            _watch = RankWatch(store, trainer.global_rank, trainer.world_size, children=children)
            _watch.start()
            atexit.register(_watch.stop)

    def on_exception(self, trainer: Trainer, pl_module: LightningModule, exception: BaseException) -> None:
        """Note that the training failed or was interrupted here, since other processes may wait for this one."""
        if _watch is not None:
            _watch.failed = True


def share_failure(error: BaseException, sentence: str) -> DeuxError | None:
    """Report this process's failure to the others, unless it failed because another one did.

    Args:
        error: the error that ends this process.
        sentence: the message that the others print.

    Returns:
        The error of the process that failed first; None if that is this process, or it is the only one.
    """
    return None if _watch is None else _watch.fail(error, sentence)
