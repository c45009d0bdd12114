"""Agreement of the predicted depth with the model's prior where the prior explains the image (FusionNet)."""

import torch
from torch import Tensor

from deux.contracts import Batch, LossInputs, LossNeed, LossTerm, Reconstructions
from deux.errors import check_range
from deux.geometry.reprojection import reproject
from deux_plugins.losses.photometric import Pixels


class TopologyPrior(LossTerm):
    """Mean absolute difference from the prior, in metres, at the pixels where the prior is trusted.

    sum(w |d - prior|) / sum(w) in each frame, then the mean over the batch. w is 1 where the colour error of the
    reconstruction with the prior is no larger than with the prediction, else 0. The colour error is the L1 norm of the
    three channels; both reconstructions are from the first source frame (t-1) only. The prior is the extra "prior" of
    the prediction, N x 1 x H x W metres. Only the prediction receives gradients, not w or the prior.

    A frame contributes zero if no pixel is trusted, or if its reconstruction is so bad that the pose may be wrong. The
    published code (`pixels="all"`) is equal for batch size 1, except that it returns NaN without any pixel; in larger
    batches, it weights each frame with the maps of all frames.

    Args:
        threshold: mean colour error of a frame, images in [0, 1], from which on it contributes zero.
        pixels: use the pixels that the source frame sees with both depths, or all.
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
        """The pixels where the prior is trusted, N x 1 x H x W bool."""
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
