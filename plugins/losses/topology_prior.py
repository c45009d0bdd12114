"""Agreement of the predicted depth with the model's prior, where the prior explains the image as well (FusionNet)."""

import torch
from torch import Tensor

from deux.contracts import Batch, LossInputs, LossNeed, LossTerm, Reconstructions
from deux.errors import check_range
from deux.geometry.reprojection import reproject
from deux_plugins.losses.photometric import Pixels


class TopologyPrior(LossTerm):
    """Mean absolute difference from the prior, in metres, at the pixels where the prior is trusted.

    sum(w |d - prior|) / sum(w) in each frame, then the mean over the batch. w is 1 where the colour error of the frame
    rebuilt with the prior is no larger than with the prediction, else 0; a colour error is the L1 norm of the three
    channels, and both are rebuilt from the first source frame (t-1) alone. The prior is the extra "prior" of the
    prediction, N x 1 x H x W metres. Gradients reach the prediction only: neither w nor the prior passes any on.

    A frame adds zero where it trusts no pixel, or where the prediction rebuilds it so badly that the pose may be to
    blame. Each frame is judged by itself. The published code (`pixels="all"`) does the same at batch size 1 but
    gives NaN without any pixel; in larger batches it weights each frame with the maps of all of them.

    Args:
        threshold: a frame's mean colour error, images in [0, 1], from which on it adds zero.
        pixels: count the pixels that the source frame sees with both depths, or all.
    """

    needs = frozenset({LossNeed.RECONSTRUCTIONS})
    extras = frozenset({"prior"})

    def __init__(self, threshold: float = 0.30, pixels: Pixels = "visible") -> None:
        check_range("topology_prior's threshold", threshold, 0.0)
        self.threshold = threshold
        self.pixels = pixels

    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value in metres."""
        assert inputs.reconstructions is not None
        prior = inputs.prediction.extras["prior"].detach().float()
        trusted = self._trusted(inputs.batch, inputs.reconstructions, prior)
        difference = (inputs.prediction.depth.float() - prior).abs()
        total = torch.where(trusted, difference, 0.0).sum(dim=(1, 2, 3))
        return (total / trusted.sum(dim=(1, 2, 3)).clamp(min=1)).mean()

    @torch.no_grad()
    def _trusted(self, batch: Batch, reconstructions: Reconstructions, prior: Tensor) -> Tensor:
        """Where the prior is compared with, N x 1 x H x W bool."""
        poses = reconstructions.source_from_target[:, :1]
        rebuilt, seen = reproject(batch.sources[:, :1], prior, batch.intrinsics, poses)
        error = _color_error(batch.image, reconstructions.images[:, 0])
        better = _color_error(batch.image, rebuilt[:, 0]) <= error
        visible = seen[:, 0] & reconstructions.visible[:, 0]
        counted = visible if self.pixels == "visible" else torch.ones_like(visible)
        total = torch.where(counted, error, 0.0).sum(dim=(1, 2, 3), keepdim=True)
        mean = total / counted.sum(dim=(1, 2, 3), keepdim=True).clamp(min=1)
        return counted & better & (mean < self.threshold)


def _color_error(image: Tensor, rebuilt: Tensor) -> Tensor:
    """L1 norm of the colour difference of N x 3 x H x W images: N x 1 x H x W."""
    return (image.float() - rebuilt.float()).abs().sum(dim=1, keepdim=True)
