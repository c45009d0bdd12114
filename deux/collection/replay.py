"""Replays a stored episode step by step, to show why its explorer acted as it did."""

from collections.abc import Iterator

import numpy as np

from deux.collection.episodes import MakeExplorer, MakeSimulator
from deux.collection.perception import Perception
from deux.collection.walk import Step, Walk, run_walks
from deux.contracts import Frame, Need, SceneReference
from deux.errors import DeuxError
from deux.inference.threads import one_thread
from deux.io.frames import read_frame
from deux.io.json_files import read_json_object
from deux.io.layout import SequencePaths


class ReplayDiverged(DeuxError):
    """An explorer acts differently than in the episode that is replayed."""


def replay(
    sequence: SequencePaths,
    scene: SceneReference,
    steps: int,
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer,
    perception: Perception | None = None,
) -> Iterator[Step]:
    """Run the explorer of a finished episode again on its stored frames, and yield each step.

    Nothing is rendered or written. An explorer's actions depend only on its seed and observations, so that it repeats
    them; its depth model, if any, predicts again. On a GPU, the last bits of predictions depend on the batch size,
    which is one here, so that the explorer may diverge.

    Args:
        sequence: a collected episode.
        scene: the scene it took place in.
        steps: the episode's maximal number of actions.
        make_simulator: creates the simulator of the scene, as for the collection.
        make_explorer: creates the explorer, as for the collection.
        perception: the depth model, as for the collection; None for explorers that need none.

    Raises:
        ReplayDiverged: the explorer acts differently; raised after the steps that agree.
        DeuxError: the episode is not finished.
    """
    try:
        record = read_json_object(sequence.folder / "episode.json")
        seed, floor = int(record["seed"]), int(record["floor"])
    except (DeuxError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise DeuxError(f"{sequence.folder} holds no finished episode to replay.") from error
    explorer = make_explorer()
    labels = Need.LABELS in explorer.needs
    reason = "so something that made it has changed"
    if perception is not None and not perception.batch_invariant:
        reason = "as the depth model's predictions here depend slightly on the batch size"

    def stored(number: int, pose: np.ndarray) -> Frame:
        frame = read_frame(sequence, number, labels)
        if frame is None or not np.array_equal(frame.pose, pose):
            raise ReplayDiverged(
                f"{sequence.folder} cannot be replayed beyond step {number}: the explorer acts differently than when "
                f"it was collected, {reason}."
            )
        return frame

    with one_thread():
        walk = Walk(make_simulator(scene), explorer, seed, steps, floor, stored)
        for (step,) in run_walks([walk], perception):
            yield step
