"""Jobs in processes of this machine (`collect.executor=local`)."""

from collections.abc import Callable, Sequence
from functools import partial

import torch

from deux.collection.jobs import CountFrames, ExplorationJob, JobRunner, run_here
from deux.inference.threads import limit_threads
from deux.io.processes import in_processes


class LocalExecutor:
    """Hands jobs out to processes of this machine, which load the depth model once each.

    Args:
        processes: number of processes that run jobs at the same time; with one, or where there is one job, this
            process runs them itself.
    """

    def __init__(self, processes: int = 1) -> None:
        self.processes = processes

    def __call__(self, run: JobRunner, jobs: Sequence[ExplorationJob], count: CountFrames) -> None:
        """Run all jobs; as `deux.collection.jobs.Executor`.

        Raises:
            DeuxError: a job failed, or a process has died.
        """
        processes = min(self.processes, len(jobs))
        if processes <= 1:
            run_here(run, jobs, count)
        else:
            in_processes(run, jobs, processes, count, _name, prepare_process(processes))


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


def _name(job: ExplorationJob) -> str:
    return f"the episodes {' and '.join(plan.folder.name for plan in job.plans)}"
