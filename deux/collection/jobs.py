"""Collection jobs, which can run in different processes, and the protocol of the executors that run them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import numpy as np

from deux.contracts import SceneReference
from deux.io.processes import Count
from deux.io.progress import Progress


@dataclass(frozen=True)
class Plan(ABC):
    """A unit of work that writes one folder. Equal plans write equal files, wherever they are executed.

    Args:
        folder: the folder of its files.
        scene: the scene that it takes place in.
    """

    folder: Path
    scene: SceneReference

    @property
    @abstractmethod
    def size(self) -> int:
        """Its size in units of progress, such as frames."""

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether all its files are on disk."""


P = TypeVar("P", bound=Plan)


@dataclass(frozen=True)
class Job(Generic[P]):
    """Plans that one process executes together; its results do not depend on other jobs.

    Args:
        plans: the plans.
        divisible: whether the plans give the same results in other groups. They do not if a depth model guides them
            whose predictions depend, in their last bits, on the size of the batch.
    """

    plans: tuple[P, ...]
    divisible: bool = False

    @property
    def size(self) -> int:
        """The sum of its plans' sizes."""
        return sum(plan.size for plan in self.plans)

    @property
    def finished(self) -> bool:
        """Whether all its files are on disk."""
        return all(plan.finished for plan in self.plans)

    def __str__(self) -> str:
        names = [plan.folder.name for plan in self.plans]
        return " and ".join(names) if len(names) <= 4 else f"{names[0]} to {names[-1]}"


JobRunner = Callable[[Job[P], Count], None]
"""Runs a job and reports its progress. It is pickled and sent once to each process that collects."""


class Executor(Protocol):
    """Runs jobs, in this process or in others, and returns when all are done."""

    def __call__(self, run: JobRunner[P], jobs: Sequence[Job[P]], count: Count) -> None:
        """Run all jobs, in any order and any number in parallel.

        Executors first divide the jobs among their workers by `share_out`.

        Args:
            run: runs a job; pickled if jobs run in other processes.
            jobs: unfinished jobs.
            count: called in this process with new progress.

        Raises:
            DeuxError: a job failed, or a process that ran one has died.
        """


def run_here(run: JobRunner[P], jobs: Sequence[Job[P]], count: Count) -> None:
    """Executor that runs the jobs one after the other in this process."""
    for job in share_out(jobs, 1, count):
        run(job, count)


def share_out(jobs: Sequence[Job[P]], workers: int, count: Count) -> list[Job[P]]:
    """Regroup divisible jobs so that all workers are evenly busy.

    The new jobs are no larger than the largest given one, and each worker gets equally many. Finished plans are
    reported as progress and left out.

    Args:
        jobs: unfinished jobs; they are returned unchanged unless all are divisible.
        workers: number of jobs that run in parallel.
        count: called with the size of finished plans.
    """
    if not all(job.divisible for job in jobs):
        return list(jobs)
    plans = [plan for job in jobs for plan in job.plans]
    waiting = [plan for plan in plans if not plan.finished]
    if len(waiting) < len(plans):
        count(sum(plan.size for plan in plans) - sum(plan.size for plan in waiting))
    if not waiting:
        return []
    largest = max(len(job.plans) for job in jobs)
    rounds = -(-len(waiting) // (workers * largest))
    groups = np.array_split(np.arange(len(waiting)), min(len(waiting), workers * rounds))
    return [replace(jobs[0], plans=tuple(waiting[k] for k in group)) for group in groups]


def run_unfinished(
    stage: str, run: JobRunner[P], jobs: Sequence[Job[P]], execute: Executor, progress: Progress
) -> None:
    """Run the jobs that are not finished.

    Args:
        stage: the name of the work in progress reports.
        run: runs a job.
        jobs: all jobs.
        execute: executes the unfinished ones.
        progress: called with the progress, which includes work of earlier runs.

    Raises:
        DeuxError: raised by `execute`.
    """
    unfinished = [job for job in jobs if not job.finished]
    total = sum(job.size for job in jobs)
    done = total - sum(job.size for job in unfinished)

    def count(new: int) -> None:
        nonlocal done
        done += new
        progress(stage, done, total)

    if unfinished:
        execute(run, unfinished, count)
