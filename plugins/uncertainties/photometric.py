"""The paper's uncertainty: the photometric residual between a frame and its reconstructions."""

from torch import Tensor

from deux.contracts import Uncertainty, View
from deux.geometry.photometric_residual import photometric_residual


class L1Residual(Uncertainty):
    """The mean absolute photometric residual of Eq. 8, in units of the image.

    If the camera only rotated, it does not depend on depth.
    """

    def __call__(self, view: View) -> Tensor:
        """N x H x W in [0, 1], NaN where no source frame sees the pixel."""
        return photometric_residual(view.image, view.rebuilt, view.visible, "l1")


class SSIMResidual(Uncertainty):
    """(1 - SSIM) / 2 of the frame and its reconstructions."""

    def __call__(self, view: View) -> Tensor:
        """N x H x W in [0, 1], NaN where no source frame sees the pixel's neighbourhood."""
        return photometric_residual(view.image, view.rebuilt, view.visible, "ssim")
