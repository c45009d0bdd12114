"""The paper's uncertainty: how far the frame is from its reconstructions."""

from torch import Tensor

from deux.geometry.photometric_residual import photometric_residual
from deux.uncertainty.view import View


def l1(view: View) -> Tensor:
    """The mean absolute photometric residual of Eq. 8, in units of the image.

    Where the camera only turned, no depth whatsoever can change it.
    """
    return photometric_residual(view.image, *view.reconstructions, "l1")


def ssim(view: View) -> Tensor:
    """(1 - SSIM) / 2 of the frame and its reconstructions."""
    return photometric_residual(view.image, *view.reconstructions, "ssim")
