"""Stage 1: robots explore several scenes at the same time, in lock-step, and their frames are stored."""

from collections.abc import Sequence
from functools import partial

from deux.collection.episodes import EpisodePlan, MakeExplorer, MakeSimulator, begin_episode
from deux.collection.perception import MODEL_NEEDS, Perception
from deux.collection.sparse import SparseSettings
from deux.collection.walk import check_perception, run_walks
from deux.contracts import DepthPredictor, Uncertainty
from deux.io.frames import FrameWriter
from deux.io.processes import in_processes
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
    processes: int = 1,
    progress: Progress = ignore_progress,
) -> None:
    """Collect episodes. What an earlier run has finished is neither rendered nor written again.

    Args:
        plans: the episodes.
        make_simulator: makes the simulator of a scene; one for each episode.
        make_explorer: makes an explorer; one for each episode.
        predict_depth: the depth model, for explorers that need what it predicts; called for all robots at once, on its
            `device` if it has one.
        sparse: how the depth model's sparse points are taken.
        uncertainty: how the depth model's prediction is judged (Eq. 8), for explorers that need the residual.
        batch_size: number of episodes that run in lock-step, and so of frames that the depth model predicts at once
            and of scenes in memory.
        processes: number of processes that collect at the same time, for explorers that need no depth model; then
            `make_simulator` and `make_explorer` must be picklable. The frames are the same for any number.
        progress: told the number of frames.

    Raises:
        DeuxError: the explorer needs a depth model or a measure of uncertainty and there is none, or the disk is full.
    """
    explorer = make_explorer()
    guided = bool(explorer.needs & MODEL_NEEDS)
    perception = Perception(predict_depth, sparse, uncertainty) if guided and predict_depth is not None else None
    check_perception(explorer, perception)
    batches = [plans[first : first + batch_size] for first in range(0, len(plans), batch_size)]
    if not guided:  # the robots do not touch each other
        batches = [[plan for plan in batch if not plan.record.exists()] for batch in batches]
    # With a model, a batch with one unfinished episode runs again as a whole: the number of frames in a batch can
    # change the last bits of what the model predicts.
    unfinished = [batch for batch in batches if not all(plan.record.exists() for plan in batch)]
    total = sum(plan.steps for plan in plans)
    count = _Count(progress, total - sum(plan.steps for batch in unfinished for plan in batch), total)
    if processes > 1 and not guided:
        work = partial(_explore_alone, make_simulator=make_simulator, make_explorer=make_explorer)
        alone = [plan for batch in unfinished for plan in batch]
        in_processes(work, alone, processes, lambda plan: count.add(plan.steps))
        return
    for batch in unfinished:
        _explore_batch(batch, make_simulator, make_explorer, perception, count)


class _Count:
    """Counts the frames that are done."""

    def __init__(self, progress: Progress, done: int, total: int) -> None:
        self._progress, self._done, self._total = progress, done, total

    def add(self, frames: int) -> None:
        self._done += frames
        self._progress(_STAGE, self._done, self._total)


def _explore_batch(
    plans: Sequence[EpisodePlan],
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer,
    perception: Perception | None,
    count: _Count,
) -> None:
    """Run episodes in lock-step and store their frames."""
    with FrameWriter() as writer:
        episodes = dict(begin_episode(plan, make_simulator(plan.scene), make_explorer(), writer) for plan in plans)
        for steps in run_walks([*episodes], perception):
            for step in steps:
                episodes[step.walk].add(step)
            count.add(len(steps))
    for walk, files in episodes.items():  # all frames are on disk now
        files.finish(walk)
        count.add(walk.steps - len(walk.actions))


def _explore_alone(plan: EpisodePlan, make_simulator: MakeSimulator, make_explorer: MakeExplorer) -> None:
    """One episode of an explorer that needs no model, in a process of its own."""
    _explore_batch([plan], make_simulator, make_explorer, None, _Count(ignore_progress, 0, plan.steps))
