"""Views, on which measures of uncertainty work, and the uncertainty of a whole frame as one number (Eq. 8)."""

import numpy as np
import torch
from torch import Tensor

from deux.broken_contracts import broken_contract
from deux.contracts import DepthPredictor, Uncertainty, View
from deux.errors import kind_of, sizes
from deux.geometry.reprojection import reproject


def make_view(
    image: Tensor,
    sparse_depth: Tensor,
    intrinsics: Tensor,
    sources: Tensor,
    source_from_target: Tensor,
    predict_depth: DepthPredictor,
) -> View:
    """Predict the depth of a batch of frames and rebuild them from their source frames (Eq. 1).

    Args:
        image: N x 3 x H x W in [0, 1]; its device is the view's.
        sparse_depth: N x 1 x H x W metres, 0 = none.
        intrinsics: N x 3 x 3.
        sources: N x S x 3 x H x W in [0, 1]; there may be none (S = 0).
        source_from_target: N x S x 4 x 4, carries points of the frame's camera into each source camera.
        predict_depth: the depth model; called once.
    """
    depth = predict_depth(image, sparse_depth, intrinsics).to(image.device, torch.float32)
    rebuilt, visible = reproject(sources, depth, intrinsics, source_from_target)
    return View(image, sparse_depth, intrinsics, depth, sources, source_from_target, predict_depth, rebuilt, visible)


def frame_of(view: View, index: int) -> View:
    """One frame of a view as a batch of one; the tensors share their memory."""
    one = slice(index, index + 1)
    return View(
        view.image[one],
        view.sparse_depth[one],
        view.intrinsics[one],
        view.depth[one],
        view.sources[one],
        view.source_from_target[one],
        view.predict_depth,
        view.rebuilt[one],
        view.visible[one],
    )


def pixel_uncertainty(measure: Uncertainty, view: View) -> Tensor:
    """What a measure makes of a view, N x H x W; only its shape and type are looked at, which waits for no device.

    Raises:
        DeuxError: the measure gives something else.
    """
    found: object = measure(view)
    count, _, height, width = view.image.shape
    wanted = (count, height, width)
    if isinstance(found, Tensor) and found.shape == wanted and found.is_floating_point():
        return found
    raise broken_contract(measure, kind_of(found), f"a Tensor of N x H x W, float32, here {sizes(wanted)}")


def check_not_negative(measure: Uncertainty, uncertainty: np.ndarray | float) -> None:
    """Raise DeuxError if what a measure gave is below 0 somewhere; for values that have arrived on the host.

    Args:
        measure: the measure.
        uncertainty: its values for some pixels, NaN where it has none, or a frame's as one number.
    """
    if np.any(np.less(uncertainty, 0.0)):
        wanted = "0 or more for each pixel: the larger, the less certain, and NaN where it has no value"
        raise broken_contract(measure, "values below 0", wanted)


def frame_uncertainty(uncertainty: Tensor) -> Tensor:
    """The uncertainty of a frame as one number, delta = 1 - exp(-mean) (Eq. 8).

    The paper averages over all pixels; here a pixel for which the measure has no value is left out.

    Args:
        uncertainty: N x H x W, what an `Uncertainty` returns.

    Returns:
        N float32 in [0, 1), NaN for a frame without any value.
    """
    return 1.0 - torch.exp(-uncertainty.flatten(1).nanmean(dim=1))
