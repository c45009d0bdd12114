"""Which measure of uncertainty follows the true errors: the numbers of a study over the walks of several scenes."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from deux.metrics.intervals import Estimate, estimate
from deux.metrics.tables import csv_text
from deux.studies.judged_walk import CONTROLS, JudgedFrame, JudgedWalk, Judgement, rank_correlation

MOVED = 0.1
"""Metres that the camera must have moved since the first source frame, for the images to know about depth."""

Kept = Literal["all", "moved"]
"""Which frames count: all, or those whose camera moved and did not only turn."""

CAUSES = ("error", "moved", "distance", "texture")
"""What a frame's uncertainty may go with: the numbers of `JudgedFrame`."""


class UncertaintyStudy:
    """The numbers of a study.

    Scenes are what differs independently: the walks of one scene, one on each of its floors, are averaged first, and
    the intervals are over scenes. A walk of which a number is not known does not count in it.

    Args:
        walks: at least one.
        measures: names of the measures that were judged.
    """

    def __init__(self, walks: Sequence[JudgedWalk], measures: Sequence[str]) -> None:
        self.walks = walks
        self.scenes = tuple(dict.fromkeys(walk.scene for walk in walks))
        """The names of the scenes."""
        self.measures = tuple(measures)
        self.names = (*measures, *CONTROLS)
        """The rows: measures, then controls."""

    def coverage(self, name: str, kept: Kept = "all") -> Estimate:
        """The fraction of the pixels with true depth for which a measure has a value."""

        def value(walk: JudgedWalk) -> float:
            shares = [f.judgements[name].coverage if name in f.judgements else 0.0 for f in _kept(walk, kept)]
            return float(np.mean(shares)) if shares else np.nan

        return self._over_scenes(value)

    def pixels(self, name: str, kept: Kept = "all") -> Estimate:
        """Rank correlation of uncertainty and error over the pixels of a frame, mean over the frames."""
        return self._mean(name, lambda judgement: judgement.rank_correlation, kept)

    def ause(self, name: str, kept: Kept = "all") -> Estimate:
        """Area under the sparsification error, mean over the frames."""
        return self._mean(name, lambda judgement: judgement.ause, kept)

    def frames(self, name: str, cause: str = "error", kept: Kept = "all") -> Estimate:
        """Rank correlation of a frame's uncertainty with one of `CAUSES`, over the frames of a walk."""

        def value(walk: JudgedWalk) -> float:
            known = [frame for frame in _kept(walk, kept) if name in frame.judgements]
            deltas = [frame.judgements[name].delta for frame in known]
            return rank_correlation(deltas, [getattr(frame, cause) for frame in known])

        return self._over_scenes(value)

    def places(self, name: str) -> Estimate:
        """Rank correlation of mean uncertainty and mean error over the places of a walk."""

        def value(walk: JudgedWalk) -> float:
            places = walk.places.get(name, [])
            return rank_correlation([place.uncertainty for place in places], [place.error for place in places])

        return self._over_scenes(value)

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
        walk_columns = ("scene", "floor")
        frame_columns = ("step", "moved", "turned", "distance", "texture", "error")
        columns = ("delta", "coverage", "rank_correlation", "ause")
        rows = [
            [
                *(getattr(walk, column) for column in walk_columns),
                *(getattr(frame, column) for column in frame_columns),
                name,
                *(getattr(judged, column) for column in columns),
            ]
            for walk in self.walks
            for frame in walk.frames
            for name, judged in frame.judgements.items()
        ]
        return csv_text([*walk_columns, *frame_columns, "measure", *columns], rows)

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
        return [frame for walk in self.walks for frame in _kept(walk, kept)]

    def _mean(self, name: str, number: Callable[[Judgement], float], kept: Kept) -> Estimate:
        def value(walk: JudgedWalk) -> float:
            values = [number(frame.judgements[name]) for frame in _kept(walk, kept) if name in frame.judgements]
            return float(np.mean(values)) if values else np.nan

        return self._over_scenes(value)

    def _over_scenes(self, value: Callable[[JudgedWalk], float]) -> Estimate:
        """A number of the walks over the scenes; NaN is that of a walk of which it is not known."""
        known = defaultdict(list)
        for walk in self.walks:
            if np.isfinite(one := value(walk)):
                known[walk.scene].append(one)
        return estimate([float(np.mean(values)) for values in known.values()])


def _kept(walk: JudgedWalk, kept: Kept) -> list[JudgedFrame]:
    return [frame for frame in walk.frames if kept == "all" or frame.moved >= MOVED]
