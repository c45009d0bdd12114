"""Jobs in processes of this machine (`collect.executor=local`)."""

from collections.abc import Callable, Sequence
from functools import partial

import torch

from deux.collection.jobs import Job, JobRunner, P, run_here, share_out
from deux.inference.threads import limit_threads
from deux.io.processes import Count, in_processes


class LocalExecutor:
    """Hands jobs out to processes of this machine, which load the depth model once each.

    Args:
        processes: number of processes that run jobs at the same time; with one, or where there is one job that cannot
            be divided, this process runs them itself.
    """

    def __init__(self, processes: int = 1) -> None:
        self.processes = processes

    def __call__(self, run: JobRunner[P], jobs: Sequence[Job[P]], count: Count) -> None:
        """Run all jobs; as `deux.collection.jobs.Executor`.

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
    """What each of several processes that share this machine does first; picklable.

    They share the threads that PyTorch takes in this process, and use its graphics card if it uses one.

    Args:
        processes: their number.
    """
    card = torch.cuda.current_device() if torch.cuda.is_initialized() else None
    return partial(_prepare, max(1, torch.get_num_threads() // processes), card)


def _prepare(threads: int, card: int | None) -> None:
    limit_threads(threads)
    if card is not None:
        torch.cuda.set_device(card)
