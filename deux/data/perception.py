"""What the depth model sees in the frames that robots are collecting, all robots in one call."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from deux.contracts import Frame
from deux.data.sparse import SparseSettings, sample_sparse
from deux.geometry.poses import source_from_target
from deux.geometry.reprojection import reproject
from deux.geometry.uncertainty import Metric, photometric_residual, uncertainty

DepthPredictor = Callable[[Tensor, Tensor, Tensor], Tensor]
"""image N x 3 x H x W in [0, 1], sparse depth N x 1 x H x W metres, intrinsics N x 3 x 3 -> depth N x 1 x H x W."""

SOURCES = 2
"""Frames before the present one that it is rebuilt from."""


class Percept(NamedTuple):
    """What the depth model makes of one robot's frame.

    Args:
        predicted_depth: H x W float32 metres.
        residual: H x W float32 mean absolute photometric error; NaN where no source frame sees the pixel.
        uncertainty: delta of Eq. 8; NaN before the third frame.
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
    metric: Metric = "l1",
) -> list[Percept]:
    """Predict the depth of every robot's newest frame in one batch and rebuild that frame from the two before.

    Args:
        histories: each robot's latest frames, newest first; all of the same length, 1 to 3.
        intrinsics: 3 x 3, of all robots' cameras.
        predict_depth: the depth model; called once.
        sparse: how sparse points are taken.
        metric: of the photometric residual.
    """
    newest = [history[0] for history in histories]
    points = np.stack([sample_sparse(frame.rgb, frame.depth, sparse) for frame in newest])
    image = _images(newest)
    matrices = torch.from_numpy(intrinsics).float().expand(len(newest), 3, 3)
    depth = predict_depth(image, torch.from_numpy(points)[:, None], matrices).float().cpu()
    if len(histories[0]) <= SOURCES:
        residual, delta = torch.full_like(depth[:, 0], torch.nan), torch.full((len(newest),), torch.nan)
    else:
        sources = torch.stack([_images(history[1 : SOURCES + 1]) for history in histories])
        motions = np.stack([_motions(history) for history in histories])
        images, visible = reproject(sources, depth, matrices, torch.from_numpy(motions).float())
        residual, delta = (
            photometric_residual(image, images, visible, metric),
            uncertainty(image, images, visible, metric),
        )
    return [Percept(depth[i, 0].numpy(), residual[i].numpy(), float(delta[i])) for i in range(len(newest))]


def _images(frames: Sequence[Frame]) -> Tensor:
    """N x 3 x H x W float32 in [0, 1]."""
    return torch.from_numpy(np.stack([frame.rgb for frame in frames])).permute(0, 3, 1, 2).float() / 255.0


def _motions(history: Sequence[Frame]) -> np.ndarray:
    """S x 4 x 4, from the newest frame's camera to those of the frames before it."""
    return np.stack([source_from_target(history[0].pose, earlier.pose) for earlier in history[1 : SOURCES + 1]])
