"""Which pixels of a predicted sequence other frames confirm (`deux.geometry.depth_agreement`), by its depth files."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from deux.contracts import FrameReference, Reader
from deux.geometry.depth_agreement import REACH, PosedDepth, agreeing_pixels, confirming_frames
from deux.tasks.prediction_folder import PredictionFolder


class AgreementFilter:
    """Compares the depth of a frame with that of its neighbours in the sequence.

    Args:
        results: where the depth of all frames lies.
        reader: of the recorded frames.
        frames: of one sequence in the order of time; those without a pose confirm nothing.
        tolerance: greatest difference of both depths as a fraction of the distance.
    """

    def __init__(
        self, results: PredictionFolder, reader: Reader, frames: Sequence[FrameReference], tolerance: float
    ) -> None:
        self._reader = reader
        self._tolerance = tolerance
        posed = [(frame, pose) for frame in frames if (pose := reader.pose(frame)) is not None]
        self._frames, self._poses = [frame for frame, _ in posed], [pose for _, pose in posed]
        self._places = {frame: place for place, frame in enumerate(self._frames)}
        self._results = results
        # What confirms one frame is confirmed by it a few frames later.
        self._view = lru_cache(maxsize=2 * REACH + 1)(self._read)

    def __call__(self, frame: FrameReference) -> np.ndarray | None:
        """The pixels that are confirmed, H x W bool; None for a frame without a pose.

        Raises:
            DeuxError: a file cannot be read.
        """
        place = self._places.get(frame)
        if place is None:
            return None
        others = (self._view(other) for other in confirming_frames(self._poses, place))
        return agreeing_pixels(self._view(place), others, self._tolerance)

    def _read(self, place: int) -> PosedDepth:
        frame = self._frames[place]
        return PosedDepth(self._results.read_depth(frame), self._reader.intrinsics(frame), self._poses[place])
