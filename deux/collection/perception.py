"""Depth predictions and their uncertainty for the frames of all exploring robots, in one batch."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from deux.collection.point_memory import PointMemory
from deux.collection.sparse import SparseSettings, sample_sparse
from deux.collection.transfers import download, upload
from deux.contracts import DepthPredictor, Frame, Need, Uncertainty, View
from deux.frame_uncertainty import frame_of, frame_uncertainty, make_view, pixel_uncertainty
from deux.geometry.depth_correction import correct_depth, point_spacing
from deux.geometry.poses import source_from_target
from deux.inference.precision import tf32_convolutions
from deux.registry import PluginChoice

MODEL_NEEDS = frozenset({Need.PREDICTED_DEPTH, Need.RESIDUAL})
"""The needs of an explorer that require a depth model."""

SOURCES = 2
"""Number of source frames, which precede the current frame."""


def needs_model(explorer: PluginChoice) -> bool:
    """Whether the explorer needs a depth model."""
    return bool(explorer.create().needs & MODEL_NEEDS)


@dataclass(frozen=True)
class Percept:
    """The depth model's prediction for one robot's frame; tensors are on the model's device.

    Args:
        view: the frame, its source frames and its predicted depth, a batch of one. An episode's first two frames have
            fewer source frames than `SOURCES`.
        residual: H x W float32, the uncertainty of each pixel; NaN where the measure has no value, and everywhere
            before the third frame. None without an uncertainty measure.
        uncertainty: scalar float32, delta of Eq. 8: the residual reduced to one number.
        corrected_depth: H x W float32 metres, the view's depth corrected by sparse points; None without correction.
    """

    view: View
    residual: Tensor | None = None
    uncertainty: Tensor | None = None
    corrected_depth: Tensor | None = None

    @property
    def depth_error(self) -> Tensor:
        """Scalar float32: `error_at_points` of the model's own prediction."""
        return error_at_points(self.view.depth[0, 0], self.view.sparse_depth[0, 0])

    @property
    def predicted_depth(self) -> Tensor:
        """H x W float32 metres, the depth that explorers map: corrected if requested, else the model's prediction."""
        return self.view.depth[0, 0] if self.corrected_depth is None else self.corrected_depth


@dataclass(frozen=True)
class HostPercept:
    """The parts of a `Percept` that an explorer needs, on the host; others are None.

    Args:
        predicted_depth: H x W float32 metres, see `Percept`.
        residual: H x W float32, see `Percept`.
        uncertainty: delta of Eq. 8.
        depth_error: see `Percept`.
    """

    predicted_depth: np.ndarray | None = None
    residual: np.ndarray | None = None
    uncertainty: float | None = None
    depth_error: float | None = None


class Perception:
    """The depth model and the uncertainty measure that guide robots.

    All frames of a step are copied to the model's device in one transfer. Predictions and uncertainty are computed
    there, in float32 (outside the network, without TensorFloat-32), and stay there until `on_host` copies them. Sparse
    points are sampled on the host, since no GPU implementation equals OpenCV's Harris corners exactly.

    Args:
        predict_depth: the depth model. If it has a `device`, as `FastPredictor` has, everything is computed there.
        sparse: how the depth model's sparse points are sampled.
        uncertainty: the uncertainty measure, which may call the model again; or None.
        correct_depth: also correct the predicted depth by sparse points (`deux.geometry.depth_correction`). View and
            residual remain those of the model's own prediction.
        remembered_frames: number of earlier frames whose sparse points correct the depth as well, where they are
            visible (`deux.collection.point_memory`).
    """

    def __init__(
        self,
        predict_depth: DepthPredictor,
        sparse: SparseSettings | None = None,
        uncertainty: Uncertainty | None = None,
        correct_depth: bool = False,
        remembered_frames: int = 0,
    ) -> None:
        self.uncertainty = uncertainty
        self._remembered_frames = remembered_frames
        self._correct_depth = correct_depth
        self._predict_depth = predict_depth
        self._sparse = sparse or SparseSettings()

    @property
    def batch_invariant(self) -> bool:
        """Whether the result for a frame is bitwise independent of the other frames of its batch.

        The depth model declares this of its predictions; everything else is computed frame by frame.
        """
        return bool(getattr(self._predict_depth, "batch_invariant", False))

    @property
    def _device(self) -> torch.device:
        """The depth model's device; not stored, since it can be another one after unpickling in another process."""
        device: torch.device = getattr(self._predict_depth, "device", torch.device("cpu"))
        return device

    @torch.inference_mode()
    @tf32_convolutions(False)
    def __call__(
        self,
        histories: Sequence[Sequence[Frame]],
        intrinsics: np.ndarray,
        memories: Sequence[PointMemory] | None = None,
    ) -> list[Percept]:
        """Predict the depth of every robot's newest frame in one batch, and compute its uncertainty.

        Args:
            histories: each robot's latest frames, newest first; all of the same length, 1 to 1 + `SOURCES`.
            intrinsics: 3 x 3, the same for all robots.
            memories: each robot's `memory`, to which the newest frame is added; None to correct the depth by the newest
                frame's points alone.
        """
        points = [sample_sparse(history[0].rgb, history[0].depth, self._sparse)[None] for history in histories]
        if self._correct_depth:
            for robot, memory in enumerate(memories or [self.memory() for _ in histories]):
                remembered = memory.add(points[robot][0], histories[robot][0].pose, intrinsics)
                points[robot] = np.stack([points[robot][0], remembered])
        view, known_depth = self._view(histories, intrinsics, points)
        views = [frame_of(view, i) for i in range(len(histories))]
        depths: list[Tensor | None] = [None] * len(views)
        if self._correct_depth:
            depths = [
                correct_depth(one.depth, known_depth[i : i + 1], point_spacing(torch.from_numpy(points[i][-1])))[0, 0]
                for i, one in enumerate(views)
            ]
        if self.uncertainty is None:
            return [Percept(one, corrected_depth=depth) for one, depth in zip(views, depths, strict=True)]
        if view.sources.shape[1] == SOURCES:
            residuals = pixel_uncertainty(self.uncertainty, view)
        else:
            residuals = torch.full_like(view.depth[:, 0], torch.nan)
        return [Percept(*parts) for parts in zip(views, residuals, frame_uncertainty(residuals), depths, strict=True)]

    def memory(self) -> PointMemory:
        """A new memory of points, for one robot's episode."""
        return PointMemory(self._remembered_frames)

    def _view(
        self,
        histories: Sequence[Sequence[Frame]],
        intrinsics: np.ndarray,
        points: Sequence[np.ndarray],
    ) -> tuple[View, Tensor]:
        """The view of the newest frames, and the points that correct their depth, N x 1 x H x W metres.

        Args:
            points: each robot's sparse depth, C x H x W metres: first that of the view, last that of the correction.
        """
        colors = np.stack([np.stack([frame.rgb for frame in history]) for history in histories])
        motions = np.stack([_motions(history) for history in histories]).astype(np.float32)
        host = [np.stack(points), motions, intrinsics.astype(np.float32), colors]
        sparse_depth, motion, matrix, color = upload(host, self._device)
        images = color.permute(0, 1, 4, 2, 3).float() / 255.0
        matrices = matrix.expand(len(histories), 3, 3)
        view = make_view(images[:, 0], sparse_depth[:, :1], matrices, images[:, 1:], motion, self._predict_depth)
        return view, sparse_depth[:, -1:]


@torch.inference_mode()
def on_host(percepts: Sequence[Percept], needs: Collection[Need]) -> list[HostPercept]:
    """Copy what explorers need to the host, in one transfer for all robots.

    Args:
        percepts: the result of one call of `Perception`.
        needs: the union of all explorers' needs.
    """
    columns: list[list[Tensor | None]] = [
        [percept.predicted_depth if Need.PREDICTED_DEPTH in needs else None for percept in percepts],
        [percept.residual if Need.RESIDUAL in needs else None for percept in percepts],
        [percept.uncertainty if Need.RESIDUAL in needs else None for percept in percepts],
        [percept.depth_error if Need.PREDICTED_DEPTH in needs else None for percept in percepts],
    ]
    arrays = iter(download([tensor for column in columns for tensor in column if tensor is not None]))
    filled = [[None if tensor is None else next(arrays) for tensor in column] for column in columns]
    return [
        HostPercept(depth, residual, *(None if number is None else float(number) for number in numbers))
        for depth, residual, *numbers in zip(*filled, strict=True)
    ]


def error_at_points(depth: Tensor, sparse_depth: Tensor) -> Tensor:
    """The median relative error of a predicted depth at the sparse points, |predicted - measured| / measured.

    These points are the model's input. After correction by them, the median error over the whole image is about as
    large: with `kbnet-indoor`, 0.022 at the points and 0.020 over the image in flats at 128 x 128 pixels, 0.062 and
    0.070 in houses at 64 x 64.

    Args:
        depth: H x W metres.
        sparse_depth: H x W metres, 0 = none.

    Returns:
        A scalar tensor; NaN without points.
    """
    errors = torch.where(sparse_depth > 0, (depth - sparse_depth).abs() / sparse_depth, torch.nan)
    return errors.nanmedian()


def _motions(history: Sequence[Frame]) -> np.ndarray:
    """S x 4 x 4, the transforms from the newest frame's camera to those of the earlier frames."""
    motions = [source_from_target(history[0].pose, earlier.pose) for earlier in history[1:]]
    return np.array(motions).reshape(-1, 4, 4)
