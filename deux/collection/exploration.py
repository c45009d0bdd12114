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
    """Runs jobs of episodes in lock-step; pickled with its depth model for each process that collects.

    On the CPU, PyTorch uses a single thread: its results, and so the frames, depend on the number of threads.

    Args:
        make_simulator: makes the simulator of a scene; one for each episode.
        make_explorer: makes an explorer; one for each episode.
        perception: the depth model and its uncertainty measure; None for explorers that need none.
    """

    make_simulator: MakeSimulator
    make_explorer: MakeExplorer
    perception: Perception | None = None

    def __call__(self, job: Job[EpisodePlan], count: Count) -> None:
        """Run a job's episodes and write their files; frames on disk are not rendered again.

        Args:
            job: the episodes.
            count: called with the number of new frames; frames that an episode lacks because it ended early are counted
                at the end.

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
    remembered_frames: int = 0,
    batch_size: int = 4,
    execute: Executor = run_here,
    progress: Progress = ignore_progress,
) -> None:
    """Collect episodes. Frames and episodes on disk are neither rendered nor written again.

    Args:
        plans: the episodes.
        make_simulator: makes the simulator of a scene; one for each episode.
        make_explorer: makes an explorer; one for each episode.
        predict_depth: the depth model, for explorers that need its predictions; called for all robots of a job at once,
            on its `device` if it has one.
        sparse: how sparse points are sampled for the depth model.
        uncertainty: the uncertainty measure (Eq. 8), for explorers that need the residual.
        correct_depth: correct the depth that these explorers receive by the sparse points (`Perception`).
        remembered_frames: number of earlier frames whose points correct it as well.
        batch_size: number of episodes that run in lock-step if a depth model guides them; this is also the number of
            frames in a batch and of scenes in memory. Each `batch_size` consecutive plans form a job, whatever executes
            it; jobs may be smaller if `predict_depth.batch_invariant` is true.
        execute: runs the jobs. If it uses other processes, all arguments must be picklable. The frames do not depend on
            where they are rendered.
        progress: called with the number of frames.

    Raises:
        DeuxError: the explorer needs a depth model or an uncertainty measure and there is none, the disk is full, or
            a process that ran a job has died.
    """
    explorer = make_explorer()
    guided = bool(explorer.needs & MODEL_NEEDS)
    perception = None
    if guided and predict_depth is not None:
        perception = Perception(predict_depth, sparse, uncertainty, correct_depth, remembered_frames)
    check_perception(explorer, perception)
    size = batch_size if guided else 1  # without a model, episodes are independent
    divisible = perception is None or perception.batch_invariant
    jobs = [Job(tuple(plans[first : first + size]), divisible) for first in range(0, len(plans), size)]
    run_unfinished("exploration", EpisodeRunner(make_simulator, make_explorer, perception), jobs, execute, progress)
