"""A stored episode step by step, as its explorer went through it: for whoever wants to see why it went there."""

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
    """An explorer goes another way than in the episode that it takes again."""


def replay(
    sequence: SequencePaths,
    scene: SceneReference,
    steps: int,
    make_simulator: MakeSimulator,
    make_explorer: MakeExplorer,
    perception: Perception | None = None,
) -> Iterator[Step]:
    """Run a finished episode again on its stored frames: the explorer, and its map, at each step.

    Nothing is rendered and nothing is written. An explorer is decided by its seed and by what it sees, so that it takes
    the same actions; the depth model, if it needs one, predicts again. On a card its predictions differ in their last
    bits with the number of frames that are predicted together, here one, and the explorer may come to go another way.

    Args:
        sequence: a collected episode.
        scene: the scene it took place in.
        steps: number of actions that it was given.
        make_simulator: makes the simulator of the scene, as it was made then.
        make_explorer: likewise the explorer.
        perception: likewise the depth model; None for explorers that need none.

    Raises:
        ReplayDiverged: the explorer goes another way; after the steps in which it did not.
        DeuxError: the episode is not finished.
    """
    try:
        record = read_json_object(sequence.folder / "episode.json")
        seed, floor = int(record["seed"]), int(record["floor"])
    except (DeuxError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise DeuxError(f"{sequence.folder} holds no finished episode that could be watched.") from error
    explorer = make_explorer()
    labels = Need.LABELS in explorer.needs
    reason = "so something that made it has changed"
    if perception is not None and not perception.batch_invariant:
        reason = "as the depth model here predicts a frame a little differently beside others than alone"

    def stored(number: int, pose: np.ndarray) -> Frame:
        frame = read_frame(sequence, number, labels)
        if frame is None or not np.array_equal(frame.pose, pose):
            raise ReplayDiverged(
                f"{sequence.folder} cannot be watched beyond step {number}: the explorer now goes another way than "
                f"when it was collected, {reason}."
            )
        return frame

    with one_thread():
        walk = Walk(make_simulator(scene), explorer, seed, steps, floor, stored)
        for (step,) in run_walks([walk], perception):
            yield step
