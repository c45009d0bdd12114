"""Exploration as jobs: the smallest pieces of work that processes take, what runs one, and who hands them out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from deux.collection.episodes import EpisodePlan, MakeExplorer, MakeSimulator, begin_episode
from deux.collection.perception import Perception
from deux.collection.walk import run_walks
from deux.inference.threads import one_thread
from deux.io.frames import FrameWriter

CountFrames = Callable[[int], None]
"""Called with the number of frames that have been done since the last call."""


@dataclass(frozen=True)
class ExplorationJob:
    """Episodes that run in lock-step; what one job writes depends on no other.

    Where a depth model guides the robots it predicts for all of a job at once, and on a card the number of frames in a
    batch may change the last bits of what it predicts: a job always runs as a whole. Otherwise a job is one episode.

    Args:
        plans: the episodes.
    """

    plans: tuple[EpisodePlan, ...]

    @property
    def frames(self) -> int:
        """Number of frames that its episodes have at most."""
        return sum(plan.steps for plan in self.plans)

    @property
    def finished(self) -> bool:
        """Whether all its episodes are on disk."""
        return all(plan.record.exists() for plan in self.plans)


@dataclass(frozen=True)
class JobRunner:
    """Runs jobs; it travels once to each process that collects, and takes the depth model along.

    What PyTorch computes on the CPU for a job is computed on one thread: the frames would depend on their number.

    Args:
        make_simulator: makes the simulator of a scene; one for each episode.
        make_explorer: makes an explorer; one for each episode.
        perception: the depth model; None for explorers that need none.
    """

    make_simulator: MakeSimulator
    make_explorer: MakeExplorer
    perception: Perception | None = None

    def __call__(self, job: ExplorationJob, count: CountFrames) -> None:
        """Run a job's episodes and write their files; what an earlier run has finished is not rendered again.

        Args:
            job: the episodes.
            count: told of frames as they come; the frames of an episode that ends early are counted at the end.

        Raises:
            DeuxError: a scene cannot be loaded, or a file cannot be written.
        """
        with one_thread(), FrameWriter() as writer:
            begun = (
                begin_episode(plan, self.make_simulator(plan.scene), self.make_explorer(), writer) for plan in job.plans
            )
            episodes = dict(begun)
            for steps in run_walks([*episodes], self.perception):
                for step in steps:
                    episodes[step.walk].add(step)
                count(len(steps))
        for walk, files in episodes.items():  # all frames are on disk now
            files.finish(walk)
            count(walk.steps - len(walk.actions))


class Executor(Protocol):
    """Hands jobs out to whatever runs them, and returns when all are done."""

    def __call__(self, run: JobRunner, jobs: Sequence[ExplorationJob], count: CountFrames) -> None:
        """Run all jobs, in any order and any number at a time.

        Args:
            run: runs one; pickled where the jobs run in other processes.
            jobs: none of them finished.
            count: told here of frames as they come.

        Raises:
            DeuxError: a job failed, or a process that ran one has died.
        """


def run_here(run: JobRunner, jobs: Sequence[ExplorationJob], count: CountFrames) -> None:
    """The executor that runs one job after the other in this process."""
    for job in jobs:
        run(job, count)
