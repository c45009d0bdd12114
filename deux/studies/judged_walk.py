"""Measures of uncertainty against the depth model's true error, frame by frame along one walk on a floor of a scene."""

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
"""Rows beside the measures: pixels in order of their predicted depth, and in an order drawn by lot."""

CELL = 0.5
"""Edge in metres of a place: a cell of the floor plan."""

CELL_PIXELS = 100
"""Pixels that a place needs, over all frames, to have an error of its own."""


@dataclass(frozen=True)
class Judgement:
    """How one measure does in one frame, over the pixels for which it has a value and whose true depth is known.

    Args:
        delta: its uncertainty as one number (Eq. 8).
        coverage: fraction of the pixels with true depth for which it has a value.
        rank_correlation: Spearman's, of uncertainty and true error over the pixels.
        ause: area between its sparsification curve and the oracle's.
        curve: its sparsification curve over the mean error, starting from 1.
        oracle: likewise of the error itself.
    """

    delta: float
    coverage: float
    rank_correlation: float
    ause: float
    curve: Sequence[float]
    oracle: Sequence[float]


@dataclass(frozen=True)
class JudgedFrame:
    """One frame.

    Args:
        step: its number in the episode.
        moved: metres that the camera moved since the first source frame.
        turned: degrees that it turned since then.
        distance: mean predicted depth in metres.
        texture: mean absolute difference of neighbouring pixels, images in [0, 1].
        error: mean absolute error of the depth in mm.
        judgements: of each measure that has values in the frame.
    """

    step: int
    moved: float
    turned: float
    distance: float
    texture: float
    error: float
    judgements: Mapping[str, Judgement]


@dataclass(frozen=True)
class Place:
    """What one measure makes of one cell of the floor plan, over all frames.

    Args:
        uncertainty: mean over the pixels that show it.
        error: mean absolute error of their depth in mm.
    """

    uncertainty: float
    error: float


@dataclass(frozen=True)
class JudgedSample:
    """The maps of one frame, for figures.

    Args:
        rgb: H x W x 3 uint8.
        error: H x W absolute error in metres, NaN where the true depth is not known.
        uncertainties: H x W maps by the measure's name, NaN where it has no value.
    """

    rgb: np.ndarray
    error: np.ndarray
    uncertainties: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class JudgedWalk:
    """A walk's frames and places.

    Args:
        scene: the scene's name.
        frames: in order of time.
        places: the cells that were seen often enough, for each measure.
        floor: the floor that it took place on, as the simulator numbers them.
    """

    scene: str
    frames: Sequence[JudgedFrame]
    places: Mapping[str, Sequence[Place]]
    floor: int = 0

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """The inverse of `dataclasses.asdict`."""
        frames = [
            JudgedFrame(**{**frame, "judgements": {n: Judgement(**j) for n, j in frame["judgements"].items()}})
            for frame in content["frames"]
        ]
        places = {name: [Place(**place) for place in places] for name, places in content["places"].items()}
        return cls(content["scene"], frames, places, content.get("floor", 0))  # earlier versions told no floor


class WalkJudge:
    """Judges the frames of one walk as they come.

    Args:
        scene: the scene's name.
        camera: the robot's camera.
        measures: that are judged, by name.
        seed: of the order by chance.
        floor: the floor's number.
    """

    def __init__(
        self, scene: str, camera: Camera, measures: Mapping[str, Uncertainty], seed: int = 0, floor: int = 0
    ) -> None:
        self._measures = measures
        self._scene, self._floor = scene, floor
        self._camera = camera
        self._rng = torch.Generator().manual_seed(seed)
        self._frames: list[JudgedFrame] = []
        self._cells: dict[str, dict[tuple[int, int], np.ndarray]] = defaultdict(_cells)

    @torch.inference_mode()
    def see(
        self,
        step: int,
        view: View,
        truth: np.ndarray,
        pose: np.ndarray,
        moved: float,
        turned: float,
        computed: Mapping[str, Tensor] | None = None,
    ) -> dict[str, np.ndarray]:
        """Judge one frame by all measures.

        Args:
            step: its number in the episode.
            view: the frame, in a batch of one.
            truth: H x W metres, 0 = none.
            pose: 4 x 4 camera-to-world.
            moved: metres since the first source frame.
            turned: degrees since then.
            computed: uncertainties of this frame, H x W, that need not be computed again, by the measure's name.

        Returns:
            The H x W maps of all measures and controls, by name; none if the true depth is known nowhere.
        """
        known = (truth > self._camera.min_depth) & (truth < self._camera.max_depth)
        if not known.any():
            return {}
        depth = view.depth[0, 0].cpu().numpy()
        error = 1000.0 * np.abs(depth - truth)
        cells = self._cells_of(truth, pose)
        maps = self._uncertainties(view, computed or {})
        judgements = {}
        for name, uncertainty in maps.items():
            judged = known & np.isfinite(uncertainty)
            if judged.sum() > 1 and error[judged].any():
                coverage = float(judged.sum() / known.sum())
                judgements[name] = _judgement(error[judged], uncertainty[judged], coverage)
                self._add(name, cells[judged], uncertainty[judged], error[judged])
        image = view.image[0].cpu().numpy()
        texture = (np.abs(np.diff(image, axis=1)).mean() + np.abs(np.diff(image, axis=2)).mean()) / 2.0
        mean_error = float(error[known].mean())
        self._frames.append(
            JudgedFrame(step, moved, turned, float(depth[known].mean()), float(texture), mean_error, judgements)
        )
        return maps

    def _uncertainties(self, view: View, computed: Mapping[str, Tensor]) -> dict[str, np.ndarray]:
        """The H x W maps of all measures and controls for the one frame of a view."""
        maps = {
            name: computed[name] if name in computed else pixel_uncertainty(measure, view)[0]
            for name, measure in self._measures.items()
        }
        by_chance = torch.rand(view.depth.shape[2:], generator=self._rng)
        maps |= dict(zip(CONTROLS, (view.depth[0, 0], by_chance), strict=True))
        found = {name: uncertainty.cpu().numpy() for name, uncertainty in maps.items()}
        for name, measure in self._measures.items():
            check_not_negative(measure, found[name])
        return found

    def result(self) -> JudgedWalk:
        """All that was seen."""
        places = {
            name: [
                Place(float(total / pixels), float(error / pixels))
                for pixels, total, error in cells.values()
                if pixels >= CELL_PIXELS
            ]
            for name, cells in self._cells.items()
        }
        return JudgedWalk(self._scene, self._frames, places, self._floor)

    def _cells_of(self, truth: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """The cell of the floor plan that each pixel shows: H x W x 2 integers."""
        points = (self._camera.rays() * truth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
        result: np.ndarray = np.floor(points[..., [0, 2]] / CELL).astype(int)
        return result

    def _add(self, name: str, cells: np.ndarray, uncertainty: np.ndarray, error: np.ndarray) -> None:
        """Count pixels, N each, in their cells, N x 2."""
        places, which = np.unique(cells, axis=0, return_inverse=True)
        sums = [np.bincount(which.ravel(), weights, len(places)) for weights in (None, uncertainty, error)]
        for place, *values in zip(places, *sums, strict=True):
            self._cells[name][int(place[0]), int(place[1])] += values


def _cells() -> dict[tuple[int, int], np.ndarray]:
    """The cells of one measure: number of pixels, sum of their uncertainty, sum of their error."""
    return defaultdict(lambda: np.zeros(3))


def _judgement(error: np.ndarray, uncertainty: np.ndarray, coverage: float) -> Judgement:
    """Hold the uncertainty of N pixels against their errors."""
    curve, oracle = sparsification_curve(error, uncertainty), sparsification_curve(error, error)
    delta = float(frame_uncertainty(torch.from_numpy(uncertainty)[None, None])[0])
    return Judgement(
        delta=delta,
        coverage=coverage,
        rank_correlation=rank_correlation(uncertainty, error),
        ause=ause(curve, oracle),
        curve=(curve / oracle[0]).tolist(),
        oracle=(oracle / oracle[0]).tolist(),
    )


def rank_correlation(first: Sequence[float] | np.ndarray, second: Sequence[float] | np.ndarray) -> float:
    """Spearman's coefficient; 0 where one side is constant and so orders nothing, NaN for fewer than two values."""
    if len(first) < 2:
        return np.nan
    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return 0.0
    return float(stats.spearmanr(first, second).statistic)
