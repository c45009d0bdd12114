"""What a measure of uncertainty looks at."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from torch import Tensor

from deux.geometry.reprojection import reproject

DepthPredictor = Callable[[Tensor, Tensor, Tensor], Tensor]
"""image N x 3 x H x W in [0, 1], sparse depth N x 1 x H x W metres, intrinsics N x 3 x 3 -> depth N x 1 x H x W."""


@dataclass(frozen=True)
class View:
    """A batch of frames with their source frames and what the depth model made of them. No ground truth is in it.

    Args:
        image: N x 3 x H x W in [0, 1].
        sparse_depth: N x 1 x H x W metres, 0 = none; the points that the depth model was given.
        intrinsics: N x 3 x 3.
        depth: N x 1 x H x W float32 metres, predicted.
        sources: N x S x 3 x H x W in [0, 1].
        source_from_target: N x S x 4 x 4, carries points of the frame's camera into each source camera.
        predict_depth: the depth model.
    """

    image: Tensor
    sparse_depth: Tensor
    intrinsics: Tensor
    depth: Tensor
    sources: Tensor
    source_from_target: Tensor
    predict_depth: DepthPredictor

    @cached_property
    def reconstructions(self) -> tuple[Tensor, Tensor]:
        """The frames rebuilt from their sources (Eq. 1) and where they are to be believed, as of `reproject`."""
        return self.rebuilt(self.depth)

    def rebuilt(self, depth: Tensor) -> tuple[Tensor, Tensor]:
        """As `reconstructions`, if the depth were another one: N x 1 x H x W metres."""
        return reproject(self.sources, depth, self.intrinsics, self.source_from_target)
