"""Evaluation of uncertainty measures against the depth model's true error, frame by frame along one walk."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import torch
from scipy import stats
from torch import Tensor

from deux.contracts import Uncertainty, View
from deux.frame_uncertainty import check_not_negative, frame_uncertainty, pixel_uncertainty
from deux.geometry.camera import Camera
from deux.metrics.sparsification import ause, sparsification_curve

CONTROLS = ("distance", "chance")
"""Control measures: the predicted depth, and random numbers."""

CELL = 0.5
"""Edge length of a place, a cell of the floor plan, in metres."""

CELL_PIXELS = 100
"""Minimal number of pixels of a place, over all frames."""


@dataclass(frozen=True)
class MeasureScores:
    """Evaluation of one measure in one frame, over the pixels with true depth for which the measure has a value.

    Args:
        delta: uncertainty of the frame as one number (Eq. 8).
        coverage: fraction of the pixels with true depth for which the measure has a value.
        rank_correlation: Spearman's rank correlation of uncertainty and true error over the pixels.
        ause: area between the sparsification curve and the oracle's.
        curve: sparsification curve relative to the mean error; it starts at 1.
        oracle: sparsification curve of the error itself, likewise.
    """

    delta: float
    coverage: float
    rank_correlation: float
    ause: float
    curve: Sequence[float]
    oracle: Sequence[float]


@dataclass(frozen=True)
class EvaluatedFrame:
    """The evaluation of all measures in one frame.

    Args:
        step: step of the episode.
        moved: distance that the camera moved since the first source frame, metres.
        turned: angle that it turned since then, degrees.
        distance: mean predicted depth, metres.
        texture: mean absolute difference of neighbouring pixels of the image, in [0, 1].
        error: mean absolute error of the depth, mm.
        scores: evaluation of each measure that has values in the frame.
    """

    step: int
    moved: float
    turned: float
    distance: float
    texture: float
    error: float
    scores: Mapping[str, MeasureScores]


@dataclass(frozen=True)
class Place:
    """Mean uncertainty and error in one cell of the floor plan, over all frames.

    Args:
        uncertainty: mean uncertainty of the pixels that show the cell.
        error: mean absolute error of their depth, mm.
    """

    uncertainty: float
    error: float


@dataclass(frozen=True)
class EvaluatedSample:
    """The maps of one frame, for figures.

    Args:
        rgb: H x W x 3 uint8.
        error: absolute error, H x W metres, NaN where the true depth is unknown.
        uncertainties: H x W maps by name of the measure, NaN where it has no value.
    """

    rgb: np.ndarray
    error: np.ndarray
    uncertainties: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class EvaluatedWalk:
    """The evaluation of a walk.

    Args:
        scene: name of the scene.
        frames: evaluations of the frames, in temporal order.
        places: places with at least `CELL_PIXELS` pixels, by name of the measure.
        floor: floor of the scene, an index into `Simulator.floors`.
    """

    scene: str
    frames: Sequence[EvaluatedFrame]
    places: Mapping[str, Sequence[Place]]
    floor: int = 0

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """The inverse of `dataclasses.asdict`."""
        frames = []
        for stored in content["frames"]:
            frame = dict(stored)
            scores = frame.pop("scores" if "scores" in frame else "judgements")  # the name in earlier versions
            frames.append(EvaluatedFrame(**frame, scores={name: MeasureScores(**one) for name, one in scores.items()}))
        places = {name: [Place(**place) for place in places] for name, places in content["places"].items()}
        return cls(content["scene"], frames, places, content.get("floor", 0))  # earlier versions stored no floor


class WalkEvaluator:
    """Evaluates uncertainty measures on the frames of one walk, one frame at a time.

    Args:
        scene: name of the scene.
        camera: the robot's camera.
        measures: the measures, by name.
        seed: seed of the random control measure.
        floor: floor of the scene, an index into `Simulator.floors`.
    """

    def __init__(
        self, scene: str, camera: Camera, measures: Mapping[str, Uncertainty], seed: int = 0, floor: int = 0
    ) -> None:
        self._measures = measures
        self._scene, self._floor = scene, floor
        self._camera = camera
        self._rng = torch.Generator().manual_seed(seed)
        self._frames: list[EvaluatedFrame] = []
        self._cells: dict[str, dict[tuple[int, int], np.ndarray]] = defaultdict(_cells)

    @torch.inference_mode()
    def add(
        self,
        step: int,
        view: View,
        truth: np.ndarray,
        pose: np.ndarray,
        moved: float,
        turned: float,
        computed: Mapping[str, Tensor] | None = None,
    ) -> dict[str, np.ndarray]:
        """Evaluate all measures on the next frame.

        Args:
            step: step of the episode.
            view: the frame, as a batch of one.
            truth: true depth, H x W metres, 0 = no value.
            pose: 4 x 4 camera-to-world pose.
            moved: distance moved since the first source frame, metres.
            turned: angle turned since then, degrees.
            computed: uncertainties of this frame that are already computed, H x W, by name of the measure.

        Returns:
            The maps of all measures and controls, H x W, by name; empty if no pixel has true depth in range.
        """
        valid = (truth > self._camera.min_depth) & (truth < self._camera.max_depth)
        if not valid.any():
            return {}
        depth = view.depth[0, 0].cpu().numpy()
        error = 1000.0 * np.abs(depth - truth)
        cells = self._cells_of(truth, pose)
        maps = self._uncertainties(view, computed or {})
        scores = {}
        for name, uncertainty in maps.items():
            evaluated = valid & np.isfinite(uncertainty)
            if evaluated.sum() > 1 and error[evaluated].any():
                coverage = float(evaluated.sum() / valid.sum())
                scores[name] = _measure_scores(error[evaluated], uncertainty[evaluated], coverage)
                self._add_to_cells(name, cells[evaluated], uncertainty[evaluated], error[evaluated])
        image = view.image[0].cpu().numpy()
        texture = (np.abs(np.diff(image, axis=1)).mean() + np.abs(np.diff(image, axis=2)).mean()) / 2.0
        mean_error = float(error[valid].mean())
        self._frames.append(
            EvaluatedFrame(step, moved, turned, float(depth[valid].mean()), float(texture), mean_error, scores)
        )
        return maps

    def _uncertainties(self, view: View, computed: Mapping[str, Tensor]) -> dict[str, np.ndarray]:
        """The maps of all measures and controls for a view of one frame, H x W each."""
        maps = {
            name: computed[name] if name in computed else pixel_uncertainty(measure, view)[0]
            for name, measure in self._measures.items()
        }
        random = torch.rand(view.depth.shape[2:], generator=self._rng)
        maps |= dict(zip(CONTROLS, (view.depth[0, 0], random), strict=True))
        arrays = {name: uncertainty.cpu().numpy() for name, uncertainty in maps.items()}
        for name, measure in self._measures.items():
            check_not_negative(measure, arrays[name])
        return arrays

    def result(self) -> EvaluatedWalk:
        """The evaluation of all frames added so far."""
        places = {
            name: [
                Place(float(total / pixels), float(error / pixels))
                for pixels, total, error in cells.values()
                if pixels >= CELL_PIXELS
            ]
            for name, cells in self._cells.items()
        }
        return EvaluatedWalk(self._scene, self._frames, places, self._floor)

    def _cells_of(self, truth: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """The cell of the floor plan that each pixel shows, H x W x 2 integers."""
        points = (self._camera.rays() * truth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
        result: np.ndarray = np.floor(points[..., [0, 2]] / CELL).astype(int)
        return result

    def _add_to_cells(self, name: str, cells: np.ndarray, uncertainty: np.ndarray, error: np.ndarray) -> None:
        """Add the uncertainties and errors of N pixels to their cells, N x 2."""
        places, which = np.unique(cells, axis=0, return_inverse=True)
        sums = [np.bincount(which.ravel(), weights, len(places)) for weights in (None, uncertainty, error)]
        for place, *values in zip(places, *sums, strict=True):
            self._cells[name][int(place[0]), int(place[1])] += values


def _cells() -> dict[tuple[int, int], np.ndarray]:
    """The cells of one measure: number of pixels, sum of uncertainty, sum of error."""
    return defaultdict(lambda: np.zeros(3))


def _measure_scores(error: np.ndarray, uncertainty: np.ndarray, coverage: float) -> MeasureScores:
    """Compare the uncertainties of N pixels with their errors."""
    curve, oracle = sparsification_curve(error, uncertainty), sparsification_curve(error, error)
    delta = float(frame_uncertainty(torch.from_numpy(uncertainty)[None, None])[0])
    return MeasureScores(
        delta=delta,
        coverage=coverage,
        rank_correlation=rank_correlation(uncertainty, error),
        ause=ause(curve, oracle),
        curve=(curve / oracle[0]).tolist(),
        oracle=(oracle / oracle[0]).tolist(),
    )


def rank_correlation(first: Sequence[float] | np.ndarray, second: Sequence[float] | np.ndarray) -> float:
    """Spearman's rank correlation; 0 if one variable is constant, NaN for fewer than two values."""
    if len(first) < 2:
        return np.nan
    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return 0.0
    return float(stats.spearmanr(first, second).statistic)
