"""Stage 1: robots explore the scenes, and their frames are stored."""

from collections.abc import Sequence
from dataclasses import dataclass

from deux.collection.episodes import EpisodePlan, MakeExplorer, MakeSimulator, begin_episode
from deux.collection.jobs import Executor, Job, run_here, run_unfinished
from deux.collection.perception import MODEL_NEEDS, Perception
from deux.collection.sparse import SparseSettings
from deux.collection.walk import check_perception, run_walks
from deux.contracts import DepthPredictor, Uncertainty
from deux.inference.threads import one_thread
from deux.io.frames import FrameWriter
from deux.io.processes import Count
from deux.io.progress import Progress, ignore_progress


@dataclass(frozen=True)
class EpisodeRunner:
    """Runs jobs of episodes in lock-step; it takes the depth model along to each process that collects.

    What PyTorch computes on the CPU for a job is computed on one thread: the frames would depend on their number.

    Args:
        make_simulator: makes the simulator of a scene; one for each episode.
        make_explorer: makes an explorer; one for each episode.
        perception: the depth model; None for explorers that need none.
    """

    make_simulator: MakeSimulator
    make_explorer: MakeExplorer
    perception: Perception | None = None

    def __call__(self, job: Job[EpisodePlan], count: Count) -> None:
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


def explore(
    plans: Sequence[EpisodePlan],
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer,
    predict_depth: DepthPredictor | None = None,
    sparse: SparseSettings | None = None,
    uncertainty: Uncertainty | None = None,
    correct_depth: bool = False,
    batch_size: int = 4,
    execute: Executor = run_here,
    progress: Progress = ignore_progress,
) -> None:
    """Collect episodes. What an earlier run has finished is neither rendered nor written again.

    Args:
        plans: the episodes.
        make_simulator: makes the simulator of a scene; one for each episode.
        make_explorer: makes an explorer; one for each episode.
        predict_depth: the depth model, for explorers that need what it predicts; called for all robots of a job at
            once, on its `device` if it has one.
        sparse: how the depth model's sparse points are taken.
        uncertainty: how the depth model's prediction is judged (Eq. 8), for explorers that need the residual.
        correct_depth: correct the depth that these explorers are given by the sparse points (`Perception`).
        batch_size: number of episodes that run in lock-step where a depth model guides them, and so of frames that it
            is given at once and of scenes in memory. The first `batch_size` plans are one job, and so on, whoever runs
            them; where `predict_depth` has a true `batch_invariant`, jobs may be smaller.
        execute: hands out the jobs. Where they run in other processes, all that is given must be picklable. The frames
            are the same wherever they run.
        progress: told the number of frames.

    Raises:
        DeuxError: the explorer needs a depth model or a measure of uncertainty and there is none, the disk is full, or
            a process that ran a job has died.
    """
    explorer = make_explorer()
    guided = bool(explorer.needs & MODEL_NEEDS)
    perception = None
    if guided and predict_depth is not None:
        perception = Perception(predict_depth, sparse, uncertainty, correct_depth)
    check_perception(explorer, perception)
    size = batch_size if guided else 1  # without a model the robots do not touch each other
    divisible = perception is None or perception.batch_invariant
    jobs = [Job(tuple(plans[first : first + size]), divisible) for first in range(0, len(plans), size)]
    run_unfinished("exploration", EpisodeRunner(make_simulator, make_explorer, perception), jobs, execute, progress)
