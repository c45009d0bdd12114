"""What the depth model sees in the frames that robots are collecting, all robots in one call."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from deux.collection.sparse import SparseSettings, sample_sparse
from deux.contracts import DepthPredictor, Frame, Need, Uncertainty, View
from deux.frame_uncertainty import frame_of, frame_uncertainty, make_view
from deux.geometry.poses import source_from_target

MODEL_NEEDS = frozenset({Need.PREDICTED_DEPTH, Need.RESIDUAL})
"""The needs of an explorer that take a depth model."""

SOURCES = 2
"""Source frames, those before the present one, that it is rebuilt from."""


@dataclass(frozen=True)
class Percept:
    """What the depth model makes of one robot's frame; the tensors are on the model's device.

    Args:
        view: the frame, its source frames and its predicted depth, a batch of one. An episode's first two frames have
            fewer source frames than `SOURCES`.
        residual: H x W float32, the uncertainty of each pixel; NaN where the measure has no value, and everywhere
            before the third frame. None where no measure was chosen.
        uncertainty: a single float32, delta of Eq. 8: the same as one number.
    """

    view: View
    residual: Tensor | None = None
    uncertainty: Tensor | None = None

    @property
    def predicted_depth(self) -> Tensor:
        """H x W float32 metres."""
        return self.view.depth[0, 0]


class Perception:
    """The depth model as robots see with it, and how its predictions are judged.

    Args:
        predict_depth: the depth model. Where it has a `device`, as `FastPredictor` has, all is computed there.
        sparse: how the depth model's sparse points are taken.
        uncertainty: the measure of uncertainty, which may call the model again; None for none.
    """

    def __init__(
        self,
        predict_depth: DepthPredictor,
        sparse: SparseSettings | None = None,
        uncertainty: Uncertainty | None = None,
    ) -> None:
        self.uncertainty = uncertainty
        self._predict_depth = predict_depth
        self._sparse = sparse or SparseSettings()

    @property
    def _device(self) -> torch.device:
        """The depth model's; not kept, as it may be another one in the process to which this travels."""
        device: torch.device = getattr(self._predict_depth, "device", torch.device("cpu"))
        return device

    @torch.inference_mode()
    def __call__(self, histories: Sequence[Sequence[Frame]], intrinsics: np.ndarray) -> list[Percept]:
        """Predict the depth of every robot's newest frame in one batch, and judge it with the frames before.

        Args:
            histories: each robot's latest frames, newest first; all of the same length, 1 to 1 + `SOURCES`.
            intrinsics: 3 x 3, of all robots' cameras.
        """
        view = self._view(histories, intrinsics)
        views = [frame_of(view, i) for i in range(len(histories))]
        if self.uncertainty is None:
            return [Percept(one) for one in views]
        if view.sources.shape[1] == SOURCES:
            residuals = self.uncertainty(view)
        else:
            residuals = torch.full_like(view.depth[:, 0], torch.nan)
        return [Percept(*parts) for parts in zip(views, residuals, frame_uncertainty(residuals), strict=True)]

    def _view(self, histories: Sequence[Sequence[Frame]], intrinsics: np.ndarray) -> View:
        newest = [history[0] for history in histories]
        points = np.stack([sample_sparse(frame.rgb, frame.depth, self._sparse) for frame in newest])
        image = self._images(newest)
        before = len(histories[0]) - 1
        sources = image.new_zeros(len(newest), before, *image.shape[1:])
        motions = image.new_zeros(len(newest), before, 4, 4)
        if before:
            sources = torch.stack([self._images(history[1:]) for history in histories])
            motions = self._on_device(np.stack([_motions(history) for history in histories])).float()
        matrices = self._on_device(intrinsics).float().expand(len(newest), 3, 3)
        return make_view(image, self._on_device(points)[:, None], matrices, sources, motions, self._predict_depth)

    def _images(self, frames: Sequence[Frame]) -> Tensor:
        """N x 3 x H x W float32 in [0, 1]."""
        return self._on_device(np.stack([frame.rgb for frame in frames])).permute(0, 3, 1, 2).float() / 255.0

    def _on_device(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(array).to(self._device)


def _motions(history: Sequence[Frame]) -> np.ndarray:
    """S x 4 x 4, from the newest frame's camera to those of the frames before it."""
    return np.stack([source_from_target(history[0].pose, earlier.pose) for earlier in history[1:]])
