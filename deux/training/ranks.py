"""Several processes that train one model (`trainer.strategy=ddp`): which of them leads, and waiting for each other.

All of them run the whole command; what they compute alone is the same in each, and the leader alone writes it.
"""

import torch
from lightning.fabric.plugins.environments import LightningEnvironment
from lightning.pytorch import Trainer
from lightning.pytorch.utilities import rank_zero_only


def leads() -> bool:
    """Whether this process is the first of those that train together, or the only one."""
    return int(getattr(rank_zero_only, "rank", 0)) == 0


def wait_for_all() -> None:
    """Wait until every process of the training has come here; nothing to wait for without several."""
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        torch.distributed.barrier()


def starts_the_command_again(trainer: Trainer) -> bool:
    """Whether the trainer will start this process's command once more for each further process, as `ddp` does here.

    On a cluster, or under torchrun, they have all been started from outside.
    """
    environment = getattr(trainer.strategy, "cluster_environment", None)
    here = isinstance(environment, LightningEnvironment) and not environment.creates_processes_externally
    return here and trainer.world_size > 1
