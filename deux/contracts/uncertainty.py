"""The contract of an uncertainty measure: the likely error of a depth map, estimated without ground truth."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

DepthPredictor = Callable[[Tensor, Tensor, Tensor], Tensor]
"""(image N x 3 x H x W in [0, 1], sparse depth N x 1 x H x W metres, intrinsics N x 3 x 3) -> depth N x 1 x H x W."""


@dataclass(frozen=True)
class View:
    """A batch of frames with their source frames and predicted depth, without ground truth.

    All tensors are on the depth model's device. `deux.frame_uncertainty.make_view` makes one.

    Args:
        image: N x 3 x H x W in [0, 1].
        sparse_depth: N x 1 x H x W metres, 0 = none; the points that were input to the depth model.
        intrinsics: N x 3 x 3.
        depth: N x 1 x H x W float32 metres, predicted.
        sources: N x S x 3 x H x W in [0, 1], at least one source frame (S >= 1) for a measure with `needs_sources`.
        source_from_target: N x S x 4 x 4, transforms points of the frame's camera to each source camera, to be
            projected with `intrinsics` (`deux.geometry.poses.absorb_intrinsics`).
        predict_depth: the depth model, for measures that compare several predictions. It takes any batch size; each
            call costs a prediction.
        rebuilt: N x S x 3 x H x W, the frames rebuilt from their sources with the predicted depth (Eq. 1).
        visible: N x S x 1 x H x W bool, false where a point lies behind the source camera or outside its image; there,
            `rebuilt` is meaningless.
    """

    image: Tensor
    sparse_depth: Tensor
    intrinsics: Tensor
    depth: Tensor
    sources: Tensor
    source_from_target: Tensor
    predict_depth: DepthPredictor
    rebuilt: Tensor
    visible: Tensor


class Uncertainty(ABC):
    """Estimates the uncertainty of each pixel of a prediction. All options are in the constructor; it has no state."""

    needs_sources: ClassVar[bool] = True
    """Whether it uses the source frames; one that does not also works for a single image."""

    @abstractmethod
    def __call__(self, view: View) -> Tensor:
        """Compute the uncertainty of each pixel; called without gradients, for frames with all their source frames.

        Args:
            view: the frames; its tensors must not be modified.

        Returns:
            N x H x W float32 on the view's device, not negative; larger is less certain. NaN where the measure has no
            value. The result of a frame does not depend on the other frames of its batch.
        """
