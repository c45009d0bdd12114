"""Disagreement between two predictions of the depth model for different inputs of the same frame."""

import torch
from torch import Tensor

from deux.contracts import Uncertainty, View


class FlipDisagreement(Uncertainty):
    """The difference in metres between the prediction and that of the flipped frame, flipped back."""

    needs_sources = False

    def __call__(self, view: View) -> Tensor:
        """N x H x W metres."""
        intrinsics = view.intrinsics.clone()
        intrinsics[:, 0, 1] *= -1  # see deux.data.sample_parts.mirrored_matrix
        intrinsics[:, 0, 2] = view.image.shape[-1] - 1 - intrinsics[:, 0, 2]
        mirrored = view.predict_depth(view.image.flip(-1), view.sparse_depth.flip(-1), intrinsics)
        return (mirrored.to(view.depth).flip(-1) - view.depth).abs()[:, 0]


class HiddenPointsDisagreement(Uncertainty):
    """The mean difference in metres between the prediction and the predictions from half of the sparse points each."""

    needs_sources = False

    def __call__(self, view: View) -> Tensor:
        """N x H x W metres."""
        points = view.sparse_depth > 0
        # Every second point in row-major order, so that both halves cover the whole image.
        odd = points.flatten(1).cumsum(1).view_as(points) % 2 == 1
        halves = torch.cat([torch.where(odd, view.sparse_depth, 0.0), torch.where(odd, 0.0, view.sparse_depth)])
        predicted = view.predict_depth(view.image.repeat(2, 1, 1, 1), halves, view.intrinsics.repeat(2, 1, 1))
        return (predicted.to(view.depth).unflatten(0, (2, -1)) - view.depth).abs().mean(0)[:, 0]
