"""The average that both photometric terms take over the pixels of their residuals."""

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

    With `sources="best"` a pixel q has the residual of the source frame that rebuilds it best,

        S / |Q| sum_{q in Q} min_s r_s(q),

    Q being the pixels that some source frame sees (Godard et al., ICCV 2019, Eq. 4, where the minimum is of the
    weighted sum of both photometric terms; here each term takes its own). What is hidden in one source frame is then
    compared with another one. S keeps the term's weight what it is with the mean.

    Args:
        pixels: count the pixels that the source frame sees, or all of them. The paper and the published models count
            all; what the source camera never saw then adds an error that no depth can lower.
        skip_points: leave out the pixels with a valid sparse point (VOICED's weights, 1 - validity).
        divisor: divide by the number of counted pixels, or of all pixels in the image. The latter rewards depths
            that move pixels out of view, so use it with `pixels="all"`.
        sources: count each source frame's residual, or at each pixel the least of all source frames.
    """

    pixels: Pixels = "visible"
    skip_points: bool = False
    divisor: Divisor = "counted"
    sources: Sources = "mean"

    def __call__(self, residual: Tensor, visible: Tensor, validity: Tensor) -> Tensor:
        """Average a residual; a frame with no counted pixel adds zero.

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
        """Mean over the counted pixels of each map, summed over the maps of a sample; arguments as of `__call__`."""
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


def _best(residual: Tensor, counted: Tensor | None) -> tuple[Tensor, Tensor | None]:
    """The least counted residual of the source frames at each pixel, N x 1 x H x W, and where there is one."""
    if counted is None:
        return residual.amin(dim=1, keepdim=True), None
    least = torch.where(counted, residual, torch.inf).amin(dim=1, keepdim=True)
    return least, counted.any(dim=1, keepdim=True)
