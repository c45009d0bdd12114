"""Several processes that train one model (`trainer.strategy=ddp`): which of them leads, and waiting for each other.

All of them run the whole command; what they compute alone is the same in each, and the leader alone writes it.
"""

import torch
from lightning.pytorch.utilities import rank_zero_only


def leads() -> bool:
    """Whether this process is the first of those that train together, or the only one."""
    return int(getattr(rank_zero_only, "rank", 0)) == 0


def wait_for_all() -> None:
    """Wait until every process of the training has come here; nothing to wait for without several."""
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        torch.distributed.barrier()
