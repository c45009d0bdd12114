"""Stage 1: robots explore the scenes, and their frames are stored."""

from collections.abc import Sequence

from deux.collection.episodes import EpisodePlan, MakeExplorer, MakeSimulator
from deux.collection.jobs import Executor, ExplorationJob, JobRunner, run_here
from deux.collection.perception import MODEL_NEEDS, Perception
from deux.collection.sparse import SparseSettings
from deux.collection.walk import check_perception
from deux.contracts import DepthPredictor, Uncertainty
from deux.io.progress import Progress, ignore_progress

_STAGE = "exploration"


def explore(
    plans: Sequence[EpisodePlan],
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer,
    predict_depth: DepthPredictor | None = None,
    sparse: SparseSettings | None = None,
    uncertainty: Uncertainty | None = None,
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
        batch_size: number of episodes that run in lock-step where a depth model guides them, and so of frames that it
            is given at once and of scenes in memory. Whoever runs them, the first `batch_size` plans are one job, and
            so on.
        execute: hands out the jobs. Where they run in other processes, all that is given must be picklable. The frames
            are the same wherever they run.
        progress: told the number of frames.

    Raises:
        DeuxError: the explorer needs a depth model or a measure of uncertainty and there is none, the disk is full, or
            a process that ran a job has died.
    """
    explorer = make_explorer()
    guided = bool(explorer.needs & MODEL_NEEDS)
    perception = Perception(predict_depth, sparse, uncertainty) if guided and predict_depth is not None else None
    check_perception(explorer, perception)
    size = batch_size if guided else 1  # without a model the robots do not touch each other
    jobs = [ExplorationJob(tuple(plans[first : first + size])) for first in range(0, len(plans), size)]
    unfinished = [job for job in jobs if not job.finished]
    total = sum(job.frames for job in jobs)
    count = _Count(progress, total - sum(job.frames for job in unfinished), total)
    execute(JobRunner(make_simulator, make_explorer, perception), unfinished, count)


class _Count:
    """Counts the frames that are done."""

    def __init__(self, progress: Progress, done: int, total: int) -> None:
        self._progress, self._done, self._total = progress, done, total

    def __call__(self, frames: int) -> None:
        self._done += frames
        self._progress(_STAGE, self._done, self._total)
