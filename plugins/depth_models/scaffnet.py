"""ScaffNet: supervised densification of sparse depth without an image (Wong, Cicek and Soatto, RA-L 2021)."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from deux.contracts import Augmentation, DepthModel, LossSettings, Prediction
from deux.geometry.sliding_max import sliding_max
from deux_plugins.depth_models.parts.convolution import Convolution
from deux_plugins.depth_models.parts.decoder import Decoder
from deux_plugins.depth_models.parts.depth_range import check_depth_range, depth_from_logits
from deux_plugins.depth_models.parts.levels import check_channels, check_levels, sizes
from deux_plugins.depth_models.parts.margin import check_margin, crop, surround_with_zeros
from deux_plugins.depth_models.parts.pooling import check_windows
from deux_plugins.depth_models.parts.vgg_encoder import VGGEncoder


class SpatialPyramidPool(nn.Module):
    """Sparse depth and its maxima in windows of several sizes, combined by 1 x 1 convolutions.

    Args:
        windows: sides of the windows, pixels.
        filters: channels of the convolutions and of the output.
        convolutions: number of 1 x 1 convolutions.
    """

    def __init__(self, windows: tuple[int, ...], filters: int = 8, convolutions: int = 3) -> None:
        super().__init__()
        check_windows("pools", windows)
        self.windows = windows
        channels = [1 + len(windows)] + [filters] * convolutions
        self.convs = nn.Sequential(*(Convolution(channels[i], channels[i + 1], kernel=1) for i in range(convolutions)))

    def forward(self, sparse_depth: Tensor) -> Tensor:
        """N x 1 x H x W metres, 0 = none, to N x filters x H x W."""
        pools = [sliding_max(sparse_depth, window) for window in self.windows]
        return self.convs(torch.cat([sparse_depth, *pools], dim=1))


class ScaffNet(DepthModel):
    """Learns the shapes of scenes from synthetic depth; it transfers to real scenes, because it sees no images.

    It is the only supervised model, and part of FusionNet. The defaults are the published SceneNet settings, with
    DEUX's depth range. Works at any image size.

    Args:
        pools: sides of the max-pooling windows of sparse depth, in pixels.
        pool_filters: channels of the pooling layer, which is also the skip connection at full resolution.
        filters: channels of the encoder's five levels.
        decoder_filters: channels of the decoder's five levels.
        min_depth: nearest predicted depth in metres.
        max_depth: farthest predicted depth in metres, to which sparse points are clamped.
        margin: see KBNet: in evaluation, sparse depth is padded by this many pixels without points, and depth is
            cropped. 0 is the published network.
    """

    supervised: ClassVar[bool] = True
    objective: ClassVar[LossSettings] = {"supervised_depth": 1.0}

    published_options: ClassVar[Mapping[str, Any]] = {"margin": 0}

    def __init__(
        self,
        pools: tuple[int, ...] = (13, 17, 19, 21, 25),
        pool_filters: int = 8,
        filters: tuple[int, ...] = (16, 32, 64, 128, 256),
        decoder_filters: tuple[int, ...] = (256, 128, 128, 64, 32),
        min_depth: float = 0.1,
        max_depth: float = 10.0,
        margin: int = 0,
    ) -> None:
        super().__init__()
        check_depth_range(min_depth, max_depth)
        check_levels(filters=filters, decoder_filters=decoder_filters)
        check_channels(pool_filters=pool_filters)
        self.min_depth = min_depth
        self.max_depth = max_depth
        check_margin(margin)
        self.margin = margin
        self.spatial_pyramid_pool = SpatialPyramidPool(tuple(pools), pool_filters)
        self.encoder = VGGEncoder(pool_filters, filters, batch_norm=True)
        self.decoder = Decoder(filters[4], [*filters[3::-1], pool_filters], decoder_filters, batch_norm=True)

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        """Predict dense depth from the sparse points, including outliers; see `DepthModel.forward`."""
        margin = 0 if self.training else self.margin
        if margin:
            sparse_depth = surround_with_zeros(sparse_depth, margin)
        pyramid = self.spatial_pyramid_pool(sparse_depth.clamp(max=self.max_depth))
        features = self.encoder(pyramid)
        *skips, latent = features
        full_size = (sparse_depth.shape[2], sparse_depth.shape[3])
        joins = [[skip] for skip in (*reversed(skips), pyramid)]
        logits = self.decoder(latent, joins, [*sizes(features), full_size])
        return Prediction(depth_from_logits(crop(logits, margin), self.min_depth, self.max_depth))

    def augmentation(self) -> Sequence[Augmentation]:
        """Mirror half of the samples horizontally."""
        from torchvision.transforms import v2  # slow to import, and not needed for inference

        return (v2.RandomHorizontalFlip(p=0.5),)

    def published_modules(self) -> dict[str, nn.Module]:
        """The modules in scaffnet-*.pth."""
        return {
            "spatial_pyramid_pool_state_dict": self.spatial_pyramid_pool,
            "scaffnet_encoder_state_dict": self.encoder,
            "scaffnet_decoder_depth_state_dict": self.decoder,
        }
