"""Views, the input of uncertainty measures, and the uncertainty of a whole frame as one number (Eq. 8)."""

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
    """Predict the depth of a batch of frames and reconstruct them from their source frames (Eq. 1).

    Args:
        image: N x 3 x H x W in [0, 1]; the view is on its device.
        sparse_depth: N x 1 x H x W metres, 0 = no value.
        intrinsics: N x 3 x 3.
        sources: N x S x 3 x H x W in [0, 1]; S may be 0.
        source_from_target: N x S x 4 x 4, transforms from the frame's camera to each source camera.
        predict_depth: the depth model; called once.
    """
    depth = predict_depth(image, sparse_depth, intrinsics).to(image.device, torch.float32)
    rebuilt, visible = reproject(sources, depth, intrinsics, source_from_target)
    return View(image, sparse_depth, intrinsics, depth, sources, source_from_target, predict_depth, rebuilt, visible)


def frame_of(view: View, index: int) -> View:
    """One frame of a view as a batch of one; the tensors share memory."""
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
    """The uncertainty of each pixel of a view, N x H x W; checks shape and type without synchronising with the device.

    Raises:
        DeuxError: the measure returns something else.
    """
    uncertainty: object = measure(view)
    count, _, height, width = view.image.shape
    shape = (count, height, width)
    if isinstance(uncertainty, Tensor) and uncertainty.shape == shape and uncertainty.is_floating_point():
        return uncertainty
    raise broken_contract(measure, kind_of(uncertainty), f"a Tensor of N x H x W, float32, here {sizes(shape)}")


def check_not_negative(measure: Uncertainty, uncertainty: np.ndarray | float) -> None:
    """Raise DeuxError if a measure has returned a negative value.

    Args:
        measure: the measure.
        uncertainty: its values on the host, for pixels (NaN where it has no value) or for a frame.
    """
    if np.any(np.less(uncertainty, 0.0)):
        wanted = "0 or more for each pixel: the larger, the less certain, and NaN where it has no value"
        raise broken_contract(measure, "values below 0", wanted)


def frame_uncertainty(uncertainty: Tensor) -> Tensor:
    """The uncertainty of a frame as one number, delta = 1 - exp(-mean) (Eq. 8).

    The paper averages over all pixels; here, pixels without a value are left out.

    Args:
        uncertainty: N x H x W, from an `Uncertainty`; NaN = no value.

    Returns:
        N float32 in [0, 1), NaN for a frame without any value.
    """
    return 1.0 - torch.exp(-uncertainty.flatten(1).nanmean(dim=1))
