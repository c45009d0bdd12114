"""Colour consistency of the reconstructions with the target frame (Eq. 2)."""

from typing import Literal

from torch import Tensor

from deux.contracts import LossInputs, LossNeed, LossTerm
from deux_plugins.losses.photometric import Divisor, PhotometricAverage, Pixels, Sources


class ColorConsistency(LossTerm):
    """L1 difference between the target frame and its reconstructions, summed over the source frames.

    The defaults are Eq. 2, restricted to pixels that the source frame sees. |.| of a colour is the L1 norm of its three
    channels, as in the published models. KBNet and FusionNet use `pixels="all"`; VOICED uses `pixels="all",
    skip_points=True, divisor="image"`.

    Args:
        channels: sum or average the absolute differences of the three channels.
        pixels: use the pixels that the source frame sees, or all.
        skip_points: exclude pixels with a valid sparse point.
        divisor: divide by the number of pixels used, or of all pixels in the image.
        sources: use each source frame's value, or at each pixel the least of all source frames.
    """

    needs = frozenset({LossNeed.RECONSTRUCTIONS})

    def __init__(
        self,
        channels: Literal["sum", "mean"] = "sum",
        pixels: Pixels = "visible",
        skip_points: bool = False,
        divisor: Divisor = "counted",
        sources: Sources = "mean",
    ) -> None:
        self.channels = channels
        self.average = PhotometricAverage(pixels, skip_points, divisor, sources)

    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value in [0, 3 S] for images in [0, 1] and S source frames."""
        batch, reconstructions = inputs.batch, inputs.reconstructions
        assert reconstructions is not None
        difference = (reconstructions.images.float() - batch.image.float()[:, None]).abs()
        residual = difference.sum(dim=2) if self.channels == "sum" else difference.mean(dim=2)
        return self.average(residual, reconstructions.visible[:, :, 0], batch.validity)
