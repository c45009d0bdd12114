"""Multi-view consistency filter of a predicted sequence (`deux.geometry.depth_agreement`), from depth files."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from deux.contracts import FrameReference, Reader
from deux.data.checked_frames import intrinsics_of, pose_of
from deux.geometry.depth_agreement import REACH, PosedDepth, agreeing_pixels, confirming_frames
from deux.tasks.prediction_folder import PredictionFolder


class AgreementFilter:
    """Selects the pixels of a frame whose depth agrees with that of its neighbours in the sequence.

    Args:
        results: the predicted depth of all frames.
        reader: reader of the recorded frames.
        frames: frames of one sequence, in temporal order; those without a pose are ignored.
        tolerance: maximal difference between two depths, as a fraction of the distance.
    """

    def __init__(
        self, results: PredictionFolder, reader: Reader, frames: Sequence[FrameReference], tolerance: float
    ) -> None:
        self._reader = reader
        self._tolerance = tolerance
        posed = [(frame, pose) for frame in frames if (pose := pose_of(reader, frame)) is not None]
        self._frames, self._poses = [frame for frame, _ in posed], [pose for _, pose in posed]
        self._indices = {frame: index for index, frame in enumerate(self._frames)}
        self._results = results
        # Neighbouring frames are compared with largely the same views.
        self._view = lru_cache(maxsize=2 * REACH + 1)(self._read)

    def __call__(self, frame: FrameReference) -> np.ndarray | None:
        """The consistent pixels of a frame, H x W bool; None for a frame without a pose.

        Raises:
            DeuxError: a file cannot be read.
        """
        index = self._indices.get(frame)
        if index is None:
            return None
        others = (self._view(other) for other in confirming_frames(self._poses, index))
        return agreeing_pixels(self._view(index), others, self._tolerance)

    def _read(self, index: int) -> PosedDepth:
        frame = self._frames[index]
        return PosedDepth(self._results.read_depth(frame), intrinsics_of(self._reader, frame), self._poses[index])
