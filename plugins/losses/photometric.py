"""The average that both photometric terms take over the pixels of their residuals."""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

Pixels = Literal["visible", "all"]
Divisor = Literal["counted", "image"]


@dataclass(frozen=True)
class PhotometricAverage:
    """Mean of a residual over the pixels of each reconstruction, summed over the source frames (Eq. 4).

    Args:
        pixels: count the pixels that the source frame sees, or all of them. The paper and the published models count
            all; what the source camera never saw then adds an error that no depth can lower.
        skip_points: leave out the pixels with a valid sparse point (VOICED's weights, 1 - validity).
        divisor: divide by the number of counted pixels, or of all pixels in the image. The latter rewards depths
            that move pixels out of view, so use it with `pixels="all"`.
    """

    pixels: Pixels = "visible"
    skip_points: bool = False
    divisor: Divisor = "counted"

    def __call__(self, residual: Tensor, visible: Tensor, validity: Tensor) -> Tensor:
        """Average a residual; a frame with no counted pixel adds zero.

        Args:
            residual: N x S x H x W.
            visible: N x S x H x W bool.
            validity: N x 1 x H x W, above 0 at the valid sparse points.
        """
        counted = self._counted(visible, validity)
        if counted is None:
            return residual.mean(dim=(0, 2, 3)).sum()
        total = torch.where(counted, residual, 0.0).sum(dim=(2, 3))
        if self.divisor == "image":
            return (total / residual[0, 0].numel()).sum(dim=1).mean()
        # `counted` may be one map for all source frames, which broadcasts.
        return (total / counted.sum(dim=(2, 3)).clamp(min=1)).sum(dim=1).mean()

    def _counted(self, visible: Tensor, validity: Tensor) -> Tensor | None:
        """The pixels that count, N x S x H x W or N x 1 x H x W bool; None for all of them."""
        if not self.skip_points:
            return visible if self.pixels == "visible" else None
        without_point = validity == 0
        return without_point & visible if self.pixels == "visible" else without_point
