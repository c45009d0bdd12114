"""Structural consistency of the reconstructions with the target frame (Eq. 3)."""

from typing import Literal

import torch.nn.functional as F
from torch import Tensor

from deux.contracts import LossInputs, LossNeed, LossTerm
from deux.errors import DeuxError
from deux.geometry.ssim import Border, Window, ssim, wholly_visible
from deux_plugins.losses.photometric import Divisor, PhotometricAverage, Pixels, Sources


class StructuralConsistency(LossTerm):
    """Structural dissimilarity of the target frame and its reconstructions, summed over the source frames.

    The defaults are Eq. 3, averaged over the channels and restricted to pixels whose whole neighbourhood the source
    frame sees. The paper does not specify the window; here it is a Gaussian on 3 x 3 pixels, the size that the
    published models use. These use `halved=True, channels="sum", window="box", pixels="all"`; KBNet also
    `border="stretch"`, and VOICED `skip_points=True, divisor="image"`.

    Args:
        halved: use (1 - SSIM) / 2 limited to [0, 1] instead of the paper's 1 - SSIM.
        channels: average or sum the values of the three channels.
        window: weights of the neighbourhood.
        window_size: side of the neighbourhood in pixels, odd; 1 compares only intensities.
        border: pad the images by reflection, or compute the values where the whole neighbourhood is inside and resize
            their map to the image's size by nearest neighbours.
        pixels: use the pixels whose neighbourhood the source frame sees, or all.
        skip_points: exclude pixels with a valid sparse point.
        divisor: divide by the number of pixels used, or of all pixels in the image.
        sources: use each source frame's value, or at each pixel the least of all source frames.

    Raises:
        DeuxError: the window has no centre pixel.
    """

    needs = frozenset({LossNeed.RECONSTRUCTIONS})

    def __init__(
        self,
        halved: bool = False,
        channels: Literal["sum", "mean"] = "mean",
        window: Window = "gaussian",
        window_size: int = 3,
        border: Literal["reflect", "stretch"] = "reflect",
        pixels: Pixels = "visible",
        skip_points: bool = False,
        divisor: Divisor = "counted",
        sources: Sources = "mean",
    ) -> None:
        if window_size < 1 or window_size % 2 == 0:
            raise DeuxError(
                f"objective.structural_consistency.window_size is {window_size}: it must be an odd number of pixels."
            )
        self.halved = halved
        self.channels = channels
        self.window = window
        self.window_size = window_size
        self.border = border
        self.average = PhotometricAverage(pixels, skip_points, divisor, sources)

    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value in [0, 2 S] (mean of channels) for S source frames."""
        batch, reconstructions = inputs.batch, inputs.reconstructions
        assert reconstructions is not None
        image, rebuilt = batch.image.float()[:, None], reconstructions.images.float()
        border: Border = "reflect" if self.border == "reflect" else "valid"
        dissimilarity = 1.0 - ssim(image, rebuilt, self.window, self.window_size, border)
        if self.halved:
            dissimilarity = (dissimilarity / 2.0).clamp(0.0, 1.0)
        residual = dissimilarity.sum(dim=2) if self.channels == "sum" else dissimilarity.mean(dim=2)
        if self.border == "stretch":
            residual = F.interpolate(residual, size=image.shape[-2:], mode="nearest")
        visible = reconstructions.visible[:, :, 0]
        if self.average.pixels == "visible":
            visible = wholly_visible(visible, self.window_size)
        return self.average(residual, visible, batch.validity)
