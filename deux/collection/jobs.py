"""Collection as jobs: the smallest pieces of work that processes take, and who hands them out."""

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
    """What is to be written into one folder. Equal plans write equal files, wherever they are carried out.

    Args:
        folder: where all its files are written.
        scene: the scene that it takes place in.
    """

    folder: Path
    scene: SceneReference

    @property
    @abstractmethod
    def size(self) -> int:
        """What progress counts of it, such as its frames."""

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether all its files are on disk."""


P = TypeVar("P", bound=Plan)


@dataclass(frozen=True)
class Job(Generic[P]):
    """Plans that one process carries out; what a job writes depends on no other.

    Args:
        plans: what is to be written.
        divisible: whether its plans may be carried out in other groups as well, and write the same. Those that a depth
            model guides may not where the number of frames in a batch changes the last bits of what it predicts.
    """

    plans: tuple[P, ...]
    divisible: bool = False

    @property
    def size(self) -> int:
        """What progress counts of all its plans."""
        return sum(plan.size for plan in self.plans)

    @property
    def finished(self) -> bool:
        """Whether all its files are on disk."""
        return all(plan.finished for plan in self.plans)

    def __str__(self) -> str:
        names = [plan.folder.name for plan in self.plans]
        return " and ".join(names) if len(names) <= 4 else f"{names[0]} to {names[-1]}"


JobRunner = Callable[[Job[P], Count], None]
"""Runs a job, and counts what is done of it. Pickled, it travels once to each process that collects."""


class Executor(Protocol):
    """Hands jobs out to whatever runs them, and returns when all are done."""

    def __call__(self, run: JobRunner[P], jobs: Sequence[Job[P]], count: Count) -> None:
        """Run all jobs, in any order and any number at a time.

        An executor knows how many jobs it runs at a time, and so divides them by `share_out` first.

        Args:
            run: runs one; pickled where the jobs run in other processes.
            jobs: none of them finished.
            count: told here of what is done, as it comes.

        Raises:
            DeuxError: a job failed, or a process that ran one has died.
        """


def run_here(run: JobRunner[P], jobs: Sequence[Job[P]], count: Count) -> None:
    """The executor that runs one job after the other in this process."""
    for job in share_out(jobs, 1, count):
        run(job, count)


def share_out(jobs: Sequence[Job[P]], workers: int, count: Count) -> list[Job[P]]:
    """Divide jobs so that all workers have something to do, evenly.

    Divisible jobs are made anew of their plans: no larger than the largest of them is, and as many for each worker. Of
    their plans those that are finished are counted, and left out.

    Args:
        jobs: none of them finished; all divisible, or none.
        workers: number of jobs that run at the same time.
        count: told of the plans that are finished.
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
    """Have the jobs run of which not all is on disk.

    Args:
        stage: what progress calls the work.
        run: runs one job.
        jobs: all of them.
        execute: hands them out.
        progress: told how much is done; what an earlier run has finished counts.

    Raises:
        DeuxError: as `execute`.
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
