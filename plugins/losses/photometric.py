"""The average over pixels and source frames that both photometric terms use."""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

Pixels = Literal["visible", "all"]
Divisor = Literal["counted", "image"]
Sources = Literal["mean", "best"]


@dataclass(frozen=True)
class PhotometricAverage:
    """Mean of a residual over the pixels of each reconstruction, summed over the source frames (Eq. 4).

    With `sources="best"`, each pixel q uses the source frame with the least residual,

        S / |Q| sum_{q in Q} min_s r_s(q),

    where Q is the set of pixels that some source frame sees (Godard et al., ICCV 2019, Eq. 4, where the minimum is over
    the weighted sum of both photometric terms; here, each term has its own). Pixels that are occluded in one source
    frame are then compared with another one. The factor S keeps the weight of the term comparable to the mean.

    Args:
        pixels: use the pixels that the source frame sees, or all. The paper and the published models use all; pixels
            that the source camera never saw then add an error that no depth can reduce.
        skip_points: exclude the pixels with a valid sparse point (VOICED's weights, 1 - validity).
        divisor: divide by the number of pixels used, or of all pixels in the image. The latter rewards depths that move
            pixels out of view, so use it with `pixels="all"`.
        sources: use each source frame's residual, or at each pixel the least of all source frames.
    """

    pixels: Pixels = "visible"
    skip_points: bool = False
    divisor: Divisor = "counted"
    sources: Sources = "mean"

    def __call__(self, residual: Tensor, visible: Tensor, validity: Tensor) -> Tensor:
        """Average a residual; frames without any pixel to use contribute zero.

        Args:
            residual: N x S x H x W.
            visible: N x S x H x W bool.
            validity: N x 1 x H x W, above 0 at the valid sparse points.
        """
        counted, frames = self._counted(visible, validity), residual.shape[1]
        if self.sources == "mean" or frames < 2:
            return self._average(residual, counted)
        return frames * self._average(*_best(residual, counted))

    def _average(self, residual: Tensor, counted: Tensor | None) -> Tensor:
        """Mean over the selected pixels of each map, summed over the maps of a sample; arguments as for `__call__`."""
        if counted is None:
            return residual.mean(dim=(0, 2, 3)).sum()
        total = torch.where(counted, residual, 0.0).sum(dim=(2, 3))
        if self.divisor == "image":
            return (total / residual[0, 0].numel()).sum(dim=1).mean()
        # `counted` can be one map for all source frames, which broadcasts.
        return (total / counted.sum(dim=(2, 3)).clamp(min=1)).sum(dim=1).mean()

    def _counted(self, visible: Tensor, validity: Tensor) -> Tensor | None:
        """The pixels to use, N x S x H x W or N x 1 x H x W bool; None for all."""
        if not self.skip_points:
            return visible if self.pixels == "visible" else None
        without_point = validity == 0
        return without_point & visible if self.pixels == "visible" else without_point


def _best(residual: Tensor, counted: Tensor | None) -> tuple[Tensor, Tensor | None]:
    """The least residual of the source frames at each pixel, N x 1 x H x W, and the pixels that have one."""
    if counted is None:
        return residual.amin(dim=1, keepdim=True), None
    least = torch.where(counted, residual, torch.inf).amin(dim=1, keepdim=True)
    return least, counted.any(dim=1, keepdim=True)
