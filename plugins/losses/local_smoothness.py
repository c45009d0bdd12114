"""Local smoothness of the predicted depth, relaxed at the edges of the image (Eq. 5)."""

from torch import Tensor

from deux.contracts import LossInputs, LossTerm


class LocalSmoothness(LossTerm):
    """Mean depth difference of neighbouring pixels, each weighted by exp(-|colour difference|).

    Eq. 5's gradients are weighted along each axis separately and added, as in the works that the paper follows; the
    image's gradient is the mean over its channels. Depth is in metres, not normalised.
    """

    def __call__(self, inputs: LossInputs) -> Tensor:
        """The term's value in metres per pixel."""
        image, depth = inputs.batch.image.float(), inputs.prediction.depth.float()
        return _weighted_variation(image, depth, axis=-1) + _weighted_variation(image, depth, axis=-2)


def _weighted_variation(image: Tensor, depth: Tensor, axis: int) -> Tensor:
    """Mean over the pairs of neighbours along one axis."""
    weight = image.diff(dim=axis).abs().mean(dim=1, keepdim=True).neg().exp()
    return (weight * depth.diff(dim=axis).abs()).mean()
