"""Which measure of uncertainty follows the true errors: the numbers of a study over the walks of several scenes."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from deux.metrics.intervals import Estimate, estimate
from deux.metrics.tables import csv_text
from deux.studies.judged_scene import CONTROLS, JudgedFrame, JudgedScene, Judgement, rank_correlation

MOVED = 0.1
"""Metres that the camera must have moved since the first source frame, for the images to know about depth."""

Kept = Literal["all", "moved"]
"""Which frames count: all, or those whose camera moved and did not only turn."""

CAUSES = ("error", "moved", "distance", "texture")
"""What a frame's uncertainty may go with: the numbers of `JudgedFrame`."""


class UncertaintyStudy:
    """The numbers of a study. Scenes are what differs independently: each gives one value, the intervals are over them.

    Args:
        scenes: at least one.
        measures: names of the measures that were judged.
    """

    def __init__(self, scenes: Sequence[JudgedScene], measures: Sequence[str]) -> None:
        self.scenes = scenes
        self.measures = tuple(measures)
        self.names = (*measures, *CONTROLS)
        """The rows: measures, then controls."""

    def coverage(self, name: str, kept: Kept = "all") -> Estimate:
        """The fraction of the pixels with true depth for which a measure has a value."""

        def value(frames: Sequence[JudgedFrame]) -> float:
            return float(np.mean([f.judgements[name].coverage if name in f.judgements else 0.0 for f in frames]))

        return self._over_scenes(value, kept)

    def pixels(self, name: str, kept: Kept = "all") -> Estimate:
        """Rank correlation of uncertainty and error over the pixels of a frame, mean over the frames."""
        return self._mean(name, lambda judgement: judgement.rank_correlation, kept)

    def ause(self, name: str, kept: Kept = "all") -> Estimate:
        """Area under the sparsification error, mean over the frames."""
        return self._mean(name, lambda judgement: judgement.ause, kept)

    def frames(self, name: str, cause: str = "error", kept: Kept = "all") -> Estimate:
        """Rank correlation of a frame's uncertainty with one of `CAUSES`, over the frames of a scene."""

        def value(frames: Sequence[JudgedFrame]) -> float:
            known = [frame for frame in frames if name in frame.judgements]
            deltas = [frame.judgements[name].delta for frame in known]
            return rank_correlation(deltas, [getattr(frame, cause) for frame in known])

        return self._over_scenes(value, kept)

    def places(self, name: str) -> Estimate:
        """Rank correlation of mean uncertainty and mean error over the places of a scene."""
        return estimate(
            [
                rank_correlation([place.uncertainty for place in places], [place.error for place in places])
                for scene in self.scenes
                if len(places := scene.places.get(name, [])) > 1
            ]
        )

    def curve(self, name: str, kept: Kept = "all") -> tuple[np.ndarray, np.ndarray]:
        """The mean sparsification curve of a measure and that of the oracle, each as a fraction of the whole error."""
        judgements = [j for frame in self._frames(kept) if (j := frame.judgements.get(name))]
        return (
            np.mean([judgement.curve for judgement in judgements], axis=0),
            np.mean([judgement.oracle for judgement in judgements], axis=0),
        )

    def count(self, kept: Kept = "all") -> int:
        """Number of frames."""
        return len(self._frames(kept))

    def frames_csv(self) -> str:
        """One row for each frame and measure, as CSV."""
        frame_columns = ("step", "moved", "turned", "distance", "texture", "error")
        columns = ("delta", "coverage", "rank_correlation", "ause")
        rows = [
            [scene.scene, *(getattr(frame, c) for c in frame_columns), name, *(getattr(judged, c) for c in columns)]
            for scene in self.scenes
            for frame in scene.frames
            for name, judged in frame.judgements.items()
        ]
        return csv_text(["scene", *frame_columns, "measure", *columns], rows)

    def summary(self) -> dict[str, dict[str, float | None]]:
        """The means of all numbers over the scenes, as JSON values."""
        numbers: dict[str, Callable[[str], Estimate]] = {
            "coverage": self.coverage,
            "rank_correlation_pixels": self.pixels,
            "ause": self.ause,
            "rank_correlation_frames": self.frames,
            "rank_correlation_places": self.places,
        }
        means = {name: {key: number(name).mean for key, number in numbers.items()} for name in self.names}
        return {name: {k: v if np.isfinite(v) else None for k, v in values.items()} for name, values in means.items()}

    def _frames(self, kept: Kept) -> list[JudgedFrame]:
        return [frame for scene in self.scenes for frame in _kept(scene, kept)]

    def _mean(self, name: str, number: Callable[[Judgement], float], kept: Kept) -> Estimate:
        def value(frames: Sequence[JudgedFrame]) -> float:
            values = [number(frame.judgements[name]) for frame in frames if name in frame.judgements]
            return float(np.mean(values)) if values else np.nan

        return self._over_scenes(value, kept)

    def _over_scenes(self, value: Callable[[Sequence[JudgedFrame]], float], kept: Kept) -> Estimate:
        values = [value(frames) for scene in self.scenes if (frames := _kept(scene, kept))]
        return estimate([one for one in values if np.isfinite(one)])


def _kept(scene: JudgedScene, kept: Kept) -> list[JudgedFrame]:
    return [frame for frame in scene.frames if kept == "all" or frame.moved >= MOVED]
