"""KBNet as a depth model of the framework."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from torch import Tensor, nn

from deux.contracts import Augmentation, DepthModel, LossSettings, Prediction
from deux_plugins.depth_models.kbnet.encoder import KBNetEncoder
from deux_plugins.depth_models.kbnet.sparse_to_dense import SparseToDensePool
from deux_plugins.depth_models.parts.decoder import Decoder
from deux_plugins.depth_models.parts.depth_range import check_depth_range, depth_from_logits
from deux_plugins.depth_models.parts.first_weights import FirstWeights, draw_he_weights
from deux_plugins.depth_models.parts.levels import check_channels, check_levels
from deux_plugins.depth_models.parts.margin import (
    check_margin,
    crop,
    move_principal_point,
    repeat_edge,
    surround_with_zeros,
)
from deux_plugins.depth_models.parts.pose_network import PoseNetwork, residual_pose_network


class KBNet(DepthModel):
    """Depth completion with calibrated backprojection layers (Wong and Soatto, ICCV 2021).

    The defaults are the published VOID settings, with DEUX's depth range. Works at any image size.

    Args:
        min_pools: sides of the min-pooling windows of sparse depth, in pixels.
        max_pools: sides of the max-pooling windows of sparse depth, in pixels.
        pool_filters: channels of the sparse-to-dense layer.
        image_filters: channels of the encoder's image branch at its five levels.
        depth_filters: channels of the encoder's depth branch at its five levels.
        decoder_filters: channels of the decoder's five levels.
        min_depth: nearest predicted depth in metres.
        max_depth: farthest predicted depth in metres.
        margin: in evaluation, images are padded on all sides by this many pixels, by repeating their edge, and depth is
            cropped. Because of zero padding without a bias, a briefly trained network predicts the outer pixels too
            near; the margin crops these. It is not used in training, which does not profit from it
            (docs/decisions/0022-border-margin.md). 0 is the published network.
        first_weights: initial weights: "glorot", as published; or "he", with which short trainings less often saturate
            at the near end (docs/decisions/0023-first-weights.md).
    """

    objective: ClassVar[LossSettings] = {
        "color_consistency": 0.15,
        "structural_consistency": 0.95,
        "sparse_depth": 2.0,
        "local_smoothness": 2.0,
    }

    published_prefix = "module."
    published_options: ClassVar[Mapping[str, Any]] = {"margin": 0}

    def __init__(
        self,
        min_pools: tuple[int, ...] = (15, 17),
        max_pools: tuple[int, ...] = (23, 27, 29),
        pool_filters: int = 8,
        image_filters: tuple[int, ...] = (48, 96, 192, 384, 384),
        depth_filters: tuple[int, ...] = (16, 32, 64, 128, 128),
        decoder_filters: tuple[int, ...] = (256, 128, 128, 64, 12),
        min_depth: float = 0.1,
        max_depth: float = 10.0,
        margin: int = 0,
        first_weights: FirstWeights = "glorot",
    ) -> None:
        super().__init__()
        check_depth_range(min_depth, max_depth)
        check_levels(image_filters=image_filters, depth_filters=depth_filters, decoder_filters=decoder_filters)
        check_channels(pool_filters=pool_filters)
        self.min_depth = min_depth
        self.max_depth = max_depth
        check_margin(margin)
        self.margin = margin
        self.sparse_to_dense_pool = SparseToDensePool(tuple(min_pools), tuple(max_pools), pool_filters)
        self.encoder = KBNetEncoder(pool_filters, image_filters, depth_filters)
        joined = [image + depth for image, depth in zip(image_filters, depth_filters, strict=True)]
        self.decoder = Decoder(joined[4], [*reversed(joined[:4]), 0], decoder_filters)
        if first_weights == "he":
            draw_he_weights(self, self.decoder.output)

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        """Predict dense depth; see `DepthModel.forward`."""
        margin = 0 if self.training else self.margin
        if margin:
            image, intrinsics = repeat_edge(image, margin), move_principal_point(intrinsics, margin)
            sparse_depth, validity = (surround_with_zeros(x, margin) for x in (sparse_depth, validity))
        depth_features = self.sparse_to_dense_pool(sparse_depth, validity)
        logits = self.decoder(*self.encoder(image, depth_features, intrinsics))
        return Prediction(depth_from_logits(crop(logits, margin), self.min_depth, self.max_depth))

    def augmentation(self) -> Sequence[Augmentation]:
        """Remove 30 to 60 % of the input points in half of the samples."""
        from deux.data.transforms import DropPoints  # imports torchvision, slow and not needed for inference

        return (DropPoints(fraction=(0.30, 0.60), p=0.5),)

    def pose_network(self) -> PoseNetwork:
        """A new pose network in the style of ResNet18."""
        return residual_pose_network()

    def published_modules(self) -> dict[str, nn.Module]:
        """The modules in kbnet-*.pth."""
        return {
            "sparse_to_dense_pool_state_dict": self.sparse_to_dense_pool,
            "encoder_state_dict": self.encoder,
            "decoder_state_dict": self.decoder,
        }
