"""Stage 1: robots explore several scenes at the same time, in lock-step, and their frames are stored."""

from collections.abc import Callable, Sequence
from functools import partial

from deux.collection.episodes import EpisodePlan, EpisodeRun, MakeExplorer, MakeSimulator
from deux.collection.perception import Percept, perceive
from deux.collection.sparse import SparseSettings
from deux.contracts import DepthPredictor, Need, Uncertainty
from deux.errors import DeuxError
from deux.io.frames import FrameWriter
from deux.io.processes import in_processes
from deux.io.progress import Progress, ignore_progress

MODEL_NEEDS = frozenset({Need.PREDICTED_DEPTH, Need.RESIDUAL})
"""The needs that take a depth model."""

_STAGE = "exploration"


def explore(
    plans: Sequence[EpisodePlan],
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer,
    predict_depth: DepthPredictor | None = None,
    sparse: SparseSettings | None = None,
    uncertainty: Uncertainty | None = None,
    together: int = 4,
    processes: int = 1,
    progress: Progress = ignore_progress,
) -> None:
    """Collect episodes. What an earlier run has finished is neither rendered nor written again.

    Args:
        plans: the episodes.
        make_simulator: makes the simulator of a scene; one for each episode.
        make_explorer: makes an explorer; one for each episode.
        predict_depth: the depth model, for explorers that need what it predicts; called for all robots at once.
        sparse: how the depth model's sparse points are taken.
        uncertainty: how the depth model's prediction is judged (Eq. 8).
        together: number of episodes that run in lock-step, and so of scenes in memory.
        processes: number of processes that collect at the same time, for explorers that need no depth model; then
            `make_simulator` and `make_explorer` must be picklable. The frames are the same for any number.
        progress: told the number of frames.

    Raises:
        DeuxError: the explorer needs a depth model and there is none, or the disk is full.
    """
    needs = make_explorer().needs
    uses_model = bool(needs & MODEL_NEEDS)
    if uses_model and predict_depth is None:
        raise DeuxError(
            f"The explorer needs {' and '.join(sorted(needs & MODEL_NEEDS))} but there is no depth model: train one "
            "first or name a checkpoint with seed.checkpoint."
        )
    groups = [plans[first : first + together] for first in range(0, len(plans), together)]
    if not uses_model:  # the robots do not touch each other
        groups = [[plan for plan in group if not plan.record.exists()] for group in groups]
    # With a model, a group with one unfinished episode runs again as a whole: the number of frames in a batch can
    # change the last bits of what the model predicts.
    unfinished = [group for group in groups if not all(plan.record.exists() for plan in group)]
    total = sum(plan.steps for plan in plans)
    count = _Count(progress, total - sum(plan.steps for group in unfinished for plan in group), total)
    if processes > 1 and not uses_model:
        alone = [plan for group in unfinished for plan in group]
        _explore_in_processes(alone, make_simulator, make_explorer, processes, count)
        return
    see = None
    if predict_depth is not None and uses_model:
        assert uncertainty is not None
        points = sparse or SparseSettings()
        see = partial(perceive, predict_depth=predict_depth, sparse=points, uncertainty=uncertainty)
    for group in unfinished:
        _explore_together(group, make_simulator, make_explorer, see, count)


class _Count:
    """Counts the frames that are done."""

    def __init__(self, progress: Progress, done: int, total: int) -> None:
        self._progress, self._done, self._total = progress, done, total

    def add(self, frames: int) -> None:
        self._done += frames
        self._progress(_STAGE, self._done, self._total)


def _explore_together(
    plans: Sequence[EpisodePlan],
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer,
    see: Callable[..., list[Percept]] | None,
    count: _Count,
) -> None:
    """Run episodes in lock-step: all observe, the model is called once, all act."""
    with FrameWriter() as writer:
        runs = [EpisodeRun(plan, make_simulator(plan.scene), make_explorer(), writer) for plan in plans]
        while active := [run for run in runs if not run.over]:
            for run in active:
                run.observe()
            percepts: list[Percept | None] = [None] * len(active)
            if see is not None:
                percepts = [*see([run.history for run in active], active[0].simulator.camera.intrinsics)]
            for run, percept in zip(active, percepts, strict=True):
                run.act(percept)
            count.add(len(active))
    for run in runs:  # all frames are on disk now
        run.finish()
        count.add(run.plan.steps - run.step)


def _explore_in_processes(
    plans: Sequence[EpisodePlan],
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer,
    processes: int,
    count: _Count,
) -> None:
    """Run each episode by itself, several processes at a time."""
    work = partial(_explore_alone, make_simulator=make_simulator, make_explorer=make_explorer)
    in_processes(work, plans, processes, lambda plan: count.add(plan.steps))


def _explore_alone(plan: EpisodePlan, make_simulator: MakeSimulator, make_explorer: MakeExplorer) -> None:
    """One episode of an explorer that needs no model, in a process of its own."""
    count = _Count(ignore_progress, 0, plan.steps)
    _explore_together([plan], make_simulator, make_explorer, None, count)
