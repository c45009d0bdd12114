"""What the depth model sees in the frames that robots are collecting, all robots in one call."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from deux.collection.sparse import SparseSettings, sample_sparse
from deux.contracts import DepthPredictor, Frame, Uncertainty, View
from deux.geometry.poses import source_from_target
from deux.uncertainty import frame_uncertainty, make_view

SOURCES = 2
"""Frames before the present one that it is rebuilt from."""


class Percept(NamedTuple):
    """What the depth model makes of one robot's frame.

    Args:
        predicted_depth: H x W float32 metres.
        residual: H x W float32, the uncertainty of each pixel; NaN where the measure says nothing.
        uncertainty: delta of Eq. 8, the same as one number; NaN before the third frame.
    """

    predicted_depth: np.ndarray
    residual: np.ndarray
    uncertainty: float


@torch.inference_mode()
def perceive(
    histories: Sequence[Sequence[Frame]],
    intrinsics: np.ndarray,
    predict_depth: DepthPredictor,
    sparse: SparseSettings,
    uncertainty: Uncertainty,
) -> list[Percept]:
    """Predict the depth of every robot's newest frame in one batch, and judge it with the help of the two before.

    Args:
        histories: each robot's latest frames, newest first; all of the same length, 1 to 3.
        intrinsics: 3 x 3, of all robots' cameras.
        predict_depth: the depth model; called once, and again by some measures of uncertainty.
        sparse: how sparse points are taken.
        uncertainty: the measure that judges the prediction.
    """
    view = look(histories, intrinsics, predict_depth, sparse)
    depth = view.depth[:, 0]
    complete = view.sources.shape[1] == SOURCES
    residual = uncertainty(view) if complete else torch.full_like(depth, torch.nan)
    delta = frame_uncertainty(residual)
    return [Percept(depth[i].numpy(), residual[i].numpy(), float(delta[i])) for i in range(len(histories))]


@torch.inference_mode()
def look(
    histories: Sequence[Sequence[Frame]], intrinsics: np.ndarray, predict_depth: DepthPredictor, sparse: SparseSettings
) -> View:
    """Every robot's newest frame with its predicted depth and, as its sources, the frames before; as `perceive`."""
    newest = [history[0] for history in histories]
    image, matrices = _images(newest), torch.from_numpy(intrinsics).float().expand(len(newest), 3, 3)
    points = np.stack([sample_sparse(frame.rgb, frame.depth, sparse) for frame in newest])
    sparse_depth = torch.from_numpy(points)[:, None]
    before = len(histories[0]) - 1
    sources = image.new_zeros(len(newest), before, *image.shape[1:])
    motions = image.new_zeros(len(newest), before, 4, 4)
    if before:
        sources = torch.stack([_images(history[1:]) for history in histories])
        motions = torch.from_numpy(np.stack([_motions(history) for history in histories])).float()
    return make_view(image, sparse_depth, matrices, sources, motions, predict_depth)


def _images(frames: Sequence[Frame]) -> Tensor:
    """N x 3 x H x W float32 in [0, 1]."""
    return torch.from_numpy(np.stack([frame.rgb for frame in frames])).permute(0, 3, 1, 2).float() / 255.0


def _motions(history: Sequence[Frame]) -> np.ndarray:
    """S x 4 x 4, from the newest frame's camera to those of the frames before it."""
    return np.stack([source_from_target(history[0].pose, earlier.pose) for earlier in history[1:]])
