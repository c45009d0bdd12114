"""The uncertainty of a frame as one number, and how a prediction is prepared to be judged (Eq. 8)."""

import torch
from torch import Tensor

from deux.contracts import DepthPredictor, View
from deux.geometry.reprojection import reproject


def make_view(
    image: Tensor,
    sparse_depth: Tensor,
    intrinsics: Tensor,
    sources: Tensor,
    source_from_target: Tensor,
    predict_depth: DepthPredictor,
) -> View:
    """Predict the depth of a batch of frames and rebuild them from their source frames; arguments as in `View`."""
    depth = predict_depth(image, sparse_depth, intrinsics).float()
    rebuilt, visible = reproject(sources, depth, intrinsics, source_from_target)
    return View(image, sparse_depth, intrinsics, depth, sources, source_from_target, predict_depth, rebuilt, visible)


def frame_uncertainty(uncertainty: Tensor) -> Tensor:
    """The uncertainty of a frame as one number, delta = 1 - exp(-mean) (Eq. 8).

    The paper averages over all pixels; here a pixel of which the measure says nothing is left out.

    Args:
        uncertainty: N x H x W, what an `Uncertainty` returns.

    Returns:
        N float32 in [0, 1), NaN for a frame without any value.
    """
    return 1.0 - torch.exp(-uncertainty.flatten(1).nanmean(dim=1))
