"""Processes that train one model together (`trainer.strategy=ddp`): which of them leads, decides and writes.

All of them run the whole command. Under torchrun or SLURM they start together; otherwise Lightning starts the others
within the first `Trainer.fit` of the leading one, and they come after it, from the command's beginning.

Every task asks who leads, and Lightning takes seconds to import: it is imported where a process may not be alone.
"""

import os
import sys
from collections.abc import Callable
from datetime import timedelta
from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from lightning.fabric.plugins.environments import ClusterEnvironment
    from lightning.pytorch import Trainer

_RANK_VARIABLES = ("RANK", "LOCAL_RANK", "SLURM_PROCID", "JSM_NAMESPACE_RANK")
"""Environment variables, one of which is set in each process that a launcher or Lightning starts."""

_DECIDED = "DEUX_DECISIONS"
"""Environment variable with the leader's decisions so far, "0" or "1" each, for the processes that it starts."""

_PATIENCE = timedelta(days=7)
"""How long the others wait for a decision; if the leader ends, so does their waiting."""

_decisions: list[bool] = []
_store: torch.distributed.Store | None = None


def leads() -> bool:
    """Whether this process is the first of those that train together, or the only one."""
    if _alone():
        return True
    from lightning.pytorch.utilities import rank_zero_only

    return int(getattr(rank_zero_only, "rank", 0)) == 0


def wait_for_all() -> None:
    """Wait until every process of the training has come here; returns at once where there is only one."""
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        torch.distributed.barrier()


def decided_by_leader(decide: Callable[[], bool]) -> bool:
    """What the leading process decides, in every process that trains with it.

    Whether a file exists may change from one process's look to another's, and then one of them trains and waits for
    ever for the other. All processes must call this equally often and in the same order, counted from their start; no
    process group is needed. The leading process must not end before the others have asked: let `wait_for_all` follow
    the last decision.

    Args:
        decide: called in the leading process only.
    """
    number = len(_decisions)
    if leads():
        _decisions.append(bool(decide()))
        os.environ[_DECIDED] = "".join(str(int(decision)) for decision in _decisions)
        if (store := _shared_store()) is not None:
            store.set(f"decision-{number}", str(int(_decisions[-1])))
    elif number < len(earlier := os.environ.get(_DECIDED, "")):
        _decisions.append(earlier[number] == "1")
    else:
        store = _shared_store()
        assert store is not None, "a process that does not lead has been started by a launcher"
        _decisions.append(store.get(f"decision-{number}") == b"1")
    return _decisions[-1]


def starts_the_command_again(trainer: "Trainer") -> bool:
    """Whether the trainer will start this process's command once more for each further process, as `ddp` does here.

    On a cluster, or under torchrun, they have all been started from outside.
    """
    from lightning.fabric.plugins.environments import LightningEnvironment

    environment = getattr(trainer.strategy, "cluster_environment", None)
    here = isinstance(environment, LightningEnvironment) and not environment.creates_processes_externally
    return here and trainer.world_size > 1


def connect_store() -> torch.distributed.Store | None:
    """A further connection to the key-value store that the processes share; None as long as there is only this one."""
    return None if _shared_store() is None else _connected(serves=False)


def _shared_store() -> torch.distributed.Store | None:
    """The key-value store that the processes share, at the address where PyTorch's process groups meet.

    Returns:
        The store; None as long as there is only this process.
    """
    global _store
    if _store is None:
        # torchrun's agent serves the store itself, and once more after each restart of its processes.
        _store = _connected(serves=leads() and os.environ.get("TORCHELASTIC_USE_AGENT_STORE") != "True")
    return _store


def _connected(serves: bool) -> torch.distributed.Store | None:
    if (environment := _launcher()) is None:
        return None
    store = torch.distributed.TCPStore(
        environment.main_address,
        environment.main_port,
        is_master=serves,
        timeout=_PATIENCE,
        wait_for_workers=False,
        multi_tenant=True,  # a process group of the same process serves its own store at this port
    )
    return torch.distributed.PrefixStore(f"deux-{os.environ.get('TORCHELASTIC_RESTART_COUNT', 0)}", store)


def _alone() -> bool:
    """Whether nothing has started this process beside others; Lightning, once imported, knows of those it starts."""
    return "lightning" not in sys.modules and not any(variable in os.environ for variable in _RANK_VARIABLES)


def _launcher() -> "ClusterEnvironment | None":
    """What has started the processes, if there are several."""
    if _alone():
        return None
    from lightning.fabric.plugins.environments import LightningEnvironment, SLURMEnvironment, TorchElasticEnvironment

    for environment in (TorchElasticEnvironment, SLURMEnvironment):
        if environment.detect():
            found: ClusterEnvironment = environment()
            return found if found.world_size() > 1 else None
    # Lightning names the address to the processes that it starts, and keeps it in its own environment.
    started_by_lightning = "LOCAL_RANK" in os.environ and "MASTER_PORT" in os.environ
    return LightningEnvironment() if started_by_lightning else None
