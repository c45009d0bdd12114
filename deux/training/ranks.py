"""Coordination of processes that train one model together (`trainer.strategy=ddp`); the leading one decides and writes.

Each process runs the whole command. Under torchrun or Slurm, all start together; otherwise Lightning starts the others,
from the beginning of the command, in the leading process's first `Trainer.fit`.

Every task uses this module, and Lightning takes seconds to import; so it is imported only if there can be several
processes.
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
"""Environment variables of the rank; launchers and Lightning set one of them in each process that they start."""

_DECIDED = "DEUX_DECISIONS"
"""Environment variable with the leading process's decisions so far, "0" or "1" each, for processes that it starts."""

_PATIENCE = timedelta(days=7)
"""How long the others wait for a decision; they stop waiting if the leading process ends."""

_decisions: list[bool] = []
_store: torch.distributed.Store | None = None


def leads() -> bool:
    """Whether this process has rank 0 or is the only one."""
    if _alone():
        return True
    from lightning.pytorch.utilities import rank_zero_only

    return int(getattr(rank_zero_only, "rank", 0)) == 0


def wait_for_all() -> None:
    """Wait until every process of the training has called this; returns immediately if there is only one."""
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        torch.distributed.barrier()


def decided_by_leader(decide: Callable[[], bool]) -> bool:
    """Decide something once, in the leading process, for all processes that train together.

    It prevents that processes decide differently, such as when one of them still sees no file that another already
    sees, and one trains while the other does not. All processes must call this equally often and in the same order from
    their start; no process group is needed. The leading process must not end before the others have called it: call
    `wait_for_all` after the last decision.

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
    """Whether the trainer will start the command again for each further process, as `ddp` does on a single machine.

    On a cluster or under torchrun, all processes were started from outside.
    """
    from lightning.fabric.plugins.environments import LightningEnvironment

    environment = getattr(trainer.strategy, "cluster_environment", None)
    here = isinstance(environment, LightningEnvironment) and not environment.creates_processes_externally
    return here and trainer.world_size > 1


def connect_store() -> torch.distributed.Store | None:
    """Open a further connection to the key-value store of all processes; None if there is only one process."""
    return None if _shared_store() is None else _connected(serves=False)


def _shared_store() -> torch.distributed.Store | None:
    """The key-value store of all processes, at the rendezvous address of PyTorch's process groups.

    Returns:
        The store; None if there is only one process.
    """
    global _store
    if _store is None:
        # torchrun's agent serves the store itself, also after a restart of its processes.
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
        multi_tenant=True,  # a process group of this process serves its own store at the same port
    )
    return torch.distributed.PrefixStore(f"deux-{os.environ.get('TORCHELASTIC_RESTART_COUNT', 0)}", store)


def _alone() -> bool:
    """Whether this is certainly the only process: no launcher started it, and Lightning is not imported."""
    return "lightning" not in sys.modules and not any(variable in os.environ for variable in _RANK_VARIABLES)


def _launcher() -> "ClusterEnvironment | None":
    """Lightning's environment of whatever started the processes; None if there is only one."""
    if _alone():
        return None
    from lightning.fabric.plugins.environments import LightningEnvironment, SLURMEnvironment, TorchElasticEnvironment

    for environment in (TorchElasticEnvironment, SLURMEnvironment):
        if environment.detect():
            found: ClusterEnvironment = environment()
            return found if found.world_size() > 1 else None
    # Lightning sets these in its own environment and in that of the processes that it starts.
    started_by_lightning = "LOCAL_RANK" in os.environ and "MASTER_PORT" in os.environ
    return LightningEnvironment() if started_by_lightning else None
