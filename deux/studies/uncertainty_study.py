"""Statistics of a study of uncertainty measures, over the walks of several scenes."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from deux.metrics.intervals import Estimate, estimate
from deux.metrics.tables import csv_text
from deux.studies.evaluated_walk import CONTROLS, EvaluatedFrame, EvaluatedWalk, MeasureScores, rank_correlation

MOVED = 0.1
"""Minimal distance in metres that the camera moved since the first source frame, for parallax between the images."""

FrameSelection = Literal["all", "moved"]
"""Which frames are evaluated: all, or those whose camera moved by at least `MOVED`."""

CAUSES = ("error", "moved", "distance", "texture")
"""Quantities of `EvaluatedFrame` that a frame's uncertainty may be correlated with."""


class UncertaintyStudy:
    """Statistics of a study.

    Scenes are the independent samples: the walks of a scene, one for each floor, are averaged first, and intervals are
    over scenes. Walks without a value are left out.

    Args:
        walks: the evaluated walks, at least one.
        measures: names of the measures.
    """

    def __init__(self, walks: Sequence[EvaluatedWalk], measures: Sequence[str]) -> None:
        self.walks = walks
        self.scenes = tuple(dict.fromkeys(walk.scene for walk in walks))
        """Names of the scenes."""
        self.measures = tuple(measures)
        self.names = (*measures, *CONTROLS)
        """Names of the rows of tables: measures, then controls."""

    def coverage(self, name: str, selection: FrameSelection = "all") -> Estimate:
        """Fraction of the pixels with true depth for which a measure has a value."""

        def value(walk: EvaluatedWalk) -> float:
            frames = _select(walk, selection)
            coverages = [frame.scores[name].coverage if name in frame.scores else 0.0 for frame in frames]
            return float(np.mean(coverages)) if coverages else np.nan

        return self._over_scenes(value)

    def pixels(self, name: str, selection: FrameSelection = "all") -> Estimate:
        """Rank correlation of uncertainty and error over the pixels of a frame, averaged over the frames."""
        return self._mean(name, lambda one: one.rank_correlation, selection)

    def ause(self, name: str, selection: FrameSelection = "all") -> Estimate:
        """Area under the sparsification error, averaged over the frames."""
        return self._mean(name, lambda one: one.ause, selection)

    def frames(self, name: str, cause: str = "error", selection: FrameSelection = "all") -> Estimate:
        """Rank correlation of a frame's uncertainty with one of `CAUSES`, over the frames of a walk."""

        def value(walk: EvaluatedWalk) -> float:
            frames = [frame for frame in _select(walk, selection) if name in frame.scores]
            deltas = [frame.scores[name].delta for frame in frames]
            return rank_correlation(deltas, [getattr(frame, cause) for frame in frames])

        return self._over_scenes(value)

    def places(self, name: str) -> Estimate:
        """Rank correlation of mean uncertainty and mean error over the places of a walk."""

        def value(walk: EvaluatedWalk) -> float:
            places = walk.places.get(name, [])
            return rank_correlation([place.uncertainty for place in places], [place.error for place in places])

        return self._over_scenes(value)

    def curve(self, name: str, selection: FrameSelection = "all") -> tuple[np.ndarray, np.ndarray]:
        """Mean sparsification curves of a measure and of the oracle, relative to the mean error."""
        scores = [j for frame in self._frames(selection) if (j := frame.scores.get(name))]
        return (
            np.mean([one.curve for one in scores], axis=0),
            np.mean([one.oracle for one in scores], axis=0),
        )

    def count(self, selection: FrameSelection = "all") -> int:
        """Number of frames."""
        return len(self._frames(selection))

    def frames_csv(self) -> str:
        """CSV with a row for each frame and measure."""
        walk_columns = ("scene", "floor")
        frame_columns = ("step", "moved", "turned", "distance", "texture", "error")
        columns = ("delta", "coverage", "rank_correlation", "ause")
        rows = [
            [
                *(getattr(walk, column) for column in walk_columns),
                *(getattr(frame, column) for column in frame_columns),
                name,
                *(getattr(one, column) for column in columns),
            ]
            for walk in self.walks
            for frame in walk.frames
            for name, one in frame.scores.items()
        ]
        return csv_text([*walk_columns, *frame_columns, "measure", *columns], rows)

    def summary(self) -> dict[str, dict[str, float | None]]:
        """The means of all statistics over scenes, as JSON values."""
        statistics: dict[str, Callable[[str], Estimate]] = {
            "coverage": self.coverage,
            "rank_correlation_pixels": self.pixels,
            "ause": self.ause,
            "rank_correlation_frames": self.frames,
            "rank_correlation_places": self.places,
        }
        means = {name: {key: statistic(name).mean for key, statistic in statistics.items()} for name in self.names}
        return {name: {k: v if np.isfinite(v) else None for k, v in values.items()} for name, values in means.items()}

    def _frames(self, selection: FrameSelection) -> list[EvaluatedFrame]:
        return [frame for walk in self.walks for frame in _select(walk, selection)]

    def _mean(self, name: str, number: Callable[[MeasureScores], float], selection: FrameSelection) -> Estimate:
        def value(walk: EvaluatedWalk) -> float:
            frames = _select(walk, selection)
            values = [number(frame.scores[name]) for frame in frames if name in frame.scores]
            return float(np.mean(values)) if values else np.nan

        return self._over_scenes(value)

    def _over_scenes(self, value: Callable[[EvaluatedWalk], float]) -> Estimate:
        """Mean and interval over scenes of a walk's value; walks with the value NaN are left out."""
        by_scene = defaultdict(list)
        for walk in self.walks:
            if np.isfinite(number := value(walk)):
                by_scene[walk.scene].append(number)
        return estimate([float(np.mean(values)) for values in by_scene.values()])


def _select(walk: EvaluatedWalk, selection: FrameSelection) -> list[EvaluatedFrame]:
    return [frame for frame in walk.frames if selection == "all" or frame.moved >= MOVED]
