"""The contract of a measure of uncertainty: how wrong a depth map may be, judged without its ground truth."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

DepthPredictor = Callable[[Tensor, Tensor, Tensor], Tensor]
"""image N x 3 x H x W in [0, 1], sparse depth N x 1 x H x W metres, intrinsics N x 3 x 3 -> depth N x 1 x H x W."""


@dataclass(frozen=True)
class View:
    """A batch of frames with their source frames and what the depth model made of them. No ground truth is in it.

    All tensors are on one device, the depth model's. `deux.frame_uncertainty.make_view` makes one.

    Args:
        image: N x 3 x H x W in [0, 1].
        sparse_depth: N x 1 x H x W metres, 0 = none; the points that the depth model was given.
        intrinsics: N x 3 x 3.
        depth: N x 1 x H x W float32 metres, predicted.
        sources: N x S x 3 x H x W in [0, 1], at least one source frame (S >= 1) for a measure with `needs_sources`.
        source_from_target: N x S x 4 x 4, carries points of the frame's camera into each source camera, for
            `intrinsics` to project them (`deux.geometry.poses.projecting_alike`).
        predict_depth: the depth model, for measures that ask it again. Each call costs a prediction, and any batch size
            may be given.
        rebuilt: N x S x 3 x H x W, the frames rebuilt from their sources with the predicted depth (Eq. 1).
        visible: N x S x 1 x H x W bool, false where a point lies behind the source camera or outside its image, so
            that `rebuilt` means nothing.
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
    """Judges a prediction pixel by pixel. All options are in the constructor; nothing is remembered between calls."""

    needs_sources: ClassVar[bool] = True
    """Whether it compares a frame with its source frames; a measure that does not can judge a single photograph."""

    @abstractmethod
    def __call__(self, view: View) -> Tensor:
        """The uncertainty of each pixel. Called without gradients, for frames that have all their source frames.

        Args:
            view: the frames; its tensors are not to be changed.

        Returns:
            N x H x W float32 on the view's device, not negative: the larger, the less certain. NaN where the measure
            has no value. What a frame gets does not depend on the others of its batch.
        """
