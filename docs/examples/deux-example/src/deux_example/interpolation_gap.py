"""A measure of uncertainty: how far the prediction is from the interpolated sparse points."""

import numpy as np
import torch
from torch import Tensor

from deux.contracts import Uncertainty, View
from deux.errors import check_range
from deux.geometry.scaffolding import interpolate


class InterpolationGap(Uncertainty):
    """|log(predicted depth / interpolated depth)|, NaN outside the convex hull of a frame's sparse points.

    The interpolation is linear over a Delaunay triangulation of the points; where the points span no triangle, each
    pixel takes the nearest point's depth, and without points all is NaN. The logarithm makes an error of a given
    percentage count the same at every distance.

    Args:
        least_depth: metres; smaller depths are taken for this one, so that the logarithm stays finite.

    Raises:
        DeuxError: `least_depth` is not above 0.
    """

    def __init__(self, least_depth: float = 0.1) -> None:
        check_range("collect.uncertainty_options.least_depth", least_depth, 0.0, ends=False)
        self.least_depth = least_depth

    def __call__(self, view: View) -> Tensor:
        """The uncertainty of each pixel, N x H x W float32."""
        points = view.sparse_depth[:, 0].cpu().numpy()
        dense = np.stack([interpolate(frame, outside="zero") for frame in points])
        between = torch.from_numpy(dense).to(view.depth.device)
        ratio = view.depth[:, 0].float().clamp(min=self.least_depth) / between.clamp(min=self.least_depth)
        return torch.where(between > 0, ratio.log().abs(), torch.nan)
