"""Jobs in processes of this machine (`collect.executor=local`)."""

from collections.abc import Callable, Sequence
from functools import partial

import torch

from deux.collection.jobs import Job, JobRunner, P, run_here, share_out
from deux.inference.threads import limit_threads
from deux.io.processes import Count, in_processes


class LocalExecutor:
    """Runs jobs in processes of this machine, each of which loads the depth model once.

    Args:
        processes: number of parallel processes; with one, or for a single indivisible job, none is started.
    """

    def __init__(self, processes: int = 1) -> None:
        self.processes = processes

    def __call__(self, run: JobRunner[P], jobs: Sequence[Job[P]], count: Count) -> None:
        """Run all jobs; see `deux.collection.jobs.Executor`.

        Raises:
            DeuxError: a job failed, or a process has died.
        """
        shared = share_out(jobs, self.processes, count)
        processes = min(self.processes, len(shared))
        if processes <= 1:
            run_here(run, shared, count)
        else:
            in_processes(run, shared, processes, count, str, prepare_process(processes))


def prepare_process(processes: int) -> Callable[[], None]:
    """The picklable initialiser of several processes that share this machine.

    They divide this process's PyTorch threads among them, and use its GPU if it uses one.

    Args:
        processes: number of processes.
    """
    card = torch.cuda.current_device() if torch.cuda.is_initialized() else None
    return partial(_prepare, max(1, torch.get_num_threads() // processes), card)


def _prepare(threads: int, card: int | None) -> None:
    limit_threads(threads)
    if card is not None:
        torch.cuda.set_device(card)
