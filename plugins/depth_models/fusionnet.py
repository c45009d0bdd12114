"""FusionNet: unsupervised depth completion from ScaffNet's topology and the image (Wong et al., RA-L 2021)."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn

from deux.contracts import Augmentation, DepthModel, Foundation, LossSettings, Prediction
from deux.geometry.sliding_max import sliding_max
from deux_plugins.depth_models.parts.decoder import Decoder
from deux_plugins.depth_models.parts.depth_range import check_depth_range, recoverable_clamp
from deux_plugins.depth_models.parts.levels import check_levels, joined, sizes
from deux_plugins.depth_models.parts.margin import check_margin, crop, repeat_edge, surround_with_zeros
from deux_plugins.depth_models.parts.pooling import check_windows
from deux_plugins.depth_models.parts.pose_network import PoseNetwork, seven_convolution_pose_network
from deux_plugins.depth_models.parts.vgg_encoder import VGGEncoder
from deux_plugins.depth_models.scaffnet import ScaffNet

MIN_FACTOR, MAX_FACTOR = 0.25, 4.0
"""Range of the factor by which the network multiplies the scaffold's depth."""

MAX_OFFSET = 1000.0
"""Largest offset in metres that the network adds, far beyond the depth range to which the sum is clamped."""


class FusionNet(DepthModel):
    """Corrects a frozen ScaffNet's depth: d = a d' + b, with a and b predicted for each pixel from image and depth.

    d' is ScaffNet's depth with its scale matched to nearby sparse points. The defaults are the published VOID settings,
    with DEUX's depth range. Works at any image size.

    Args:
        image_filters: channels of the image encoder at its five levels.
        depth_filters: channels of the depth encoder at its five levels.
        decoder_filters: channels of the decoder's five levels.
        scale_window: side of the window around a sparse point in which it determines the scale of ScaffNet's depth, an
            odd number of pixels.
        scaffnet_pools: ScaffNet's `pools`.
        scaffnet_filters: ScaffNet's `filters`.
        scaffnet_decoder_filters: ScaffNet's `decoder_filters`.
        min_depth: nearest predicted depth in metres.
        max_depth: farthest predicted depth in metres.
        scaffnet_min_depth: ScaffNet's `min_depth`; None for FusionNet's own.
        scaffnet_max_depth: ScaffNet's `max_depth`; None for FusionNet's own. The published values differ: 10 m on VOID,
            with 8 m for FusionNet, and 80 m on KITTI, with 100 m for FusionNet.
        margin: see KBNet: in evaluation, images are padded by this many pixels, and depth is cropped. ScaffNet's points
            are padded, too. 0 is the published network.
    """

    objective: ClassVar[LossSettings] = {
        "color_consistency": 0.20,
        "structural_consistency": 0.80,
        "sparse_depth": 1.0,
        "local_smoothness": 1.0,
        "topology_prior": 0.10,
    }

    published_options: ClassVar[Mapping[str, Any]] = {"margin": 0}

    def __init__(
        self,
        image_filters: tuple[int, ...] = (48, 96, 192, 384, 384),
        depth_filters: tuple[int, ...] = (16, 32, 64, 128, 128),
        decoder_filters: tuple[int, ...] = (256, 128, 128, 64, 32),
        scale_window: int = 5,
        scaffnet_pools: tuple[int, ...] = (13, 17, 19, 21, 25),
        scaffnet_filters: tuple[int, ...] = (16, 32, 64, 128, 256),
        scaffnet_decoder_filters: tuple[int, ...] = (256, 128, 128, 64, 32),
        min_depth: float = 0.1,
        max_depth: float = 10.0,
        scaffnet_min_depth: float | None = None,
        scaffnet_max_depth: float | None = None,
        margin: int = 0,
    ) -> None:
        super().__init__()
        check_depth_range(min_depth, max_depth)
        check_levels(image_filters=image_filters, depth_filters=depth_filters, decoder_filters=decoder_filters)
        check_levels(scaffnet_filters=scaffnet_filters, scaffnet_decoder_filters=scaffnet_decoder_filters)
        self.min_depth = min_depth
        self.max_depth = max_depth
        check_margin(margin)
        self.margin = margin
        check_windows("model.scale_window", (scale_window,))
        self.scale_window = scale_window
        self.scaffnet_settings: dict[str, Any] = {
            "pools": scaffnet_pools,
            "filters": scaffnet_filters,
            "decoder_filters": scaffnet_decoder_filters,
            "min_depth": min_depth if scaffnet_min_depth is None else scaffnet_min_depth,
            "max_depth": max_depth if scaffnet_max_depth is None else scaffnet_max_depth,
        }
        check_depth_range(self.scaffnet_settings["min_depth"], self.scaffnet_settings["max_depth"], "scaffnet_")
        self.scaffnet = ScaffNet(**self.scaffnet_settings).requires_grad_(False).eval()
        self.encoder_image = VGGEncoder(3, image_filters)
        self.encoder_depth = VGGEncoder(2, depth_filters)
        channels = [image + depth for image, depth in zip(image_filters, depth_filters, strict=True)]
        self.decoder = Decoder(channels[4], [*channels[3::-1], 0], decoder_filters, out_channels=2)

    def train(self, mode: bool = True) -> Self:
        """Set the mode of all modules but ScaffNet, which keeps the batch statistics of its own training."""
        super().train(mode)
        self.scaffnet.eval()
        return self

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        """Predict dense depth; see `DepthModel.forward`. `extras["prior"]` is ScaffNet's unscaled depth."""
        margin = 0 if self.training else self.margin
        if margin:
            image = repeat_edge(image, margin)
            sparse_depth, validity = (surround_with_zeros(x, margin) for x in (sparse_depth, validity))
        with torch.no_grad():
            prior = self.scaffnet(image, sparse_depth, validity, intrinsics).depth
        points = sparse_depth * validity
        scaffold = match_scale(prior, points, self.scale_window)
        # ScaffNet's depth is float32 even if the networks compute in half precision.
        depth_inputs = torch.cat([scaffold, points.clamp(max=self.max_depth)], dim=1).to(image.dtype)
        features = joined(self.encoder_image(image), self.encoder_depth(depth_inputs))
        *skips, latent = features
        full_size = (image.shape[2], image.shape[3])
        joins = [*([skip] for skip in reversed(skips)), []]
        logits, offset = self.decoder(latent, joins, [*sizes(features), full_size]).split(1, dim=1)
        factor = MIN_FACTOR + (MAX_FACTOR - MIN_FACTOR) * torch.sigmoid(logits)
        depth = factor * scaffold + recoverable_clamp(offset, -MAX_OFFSET, MAX_OFFSET)
        depth = recoverable_clamp(depth, self.min_depth, self.max_depth)
        return Prediction(crop(depth, margin), {"prior": crop(prior, margin)})

    def augmentation(self) -> Sequence[Augmentation]:
        """Mirror half of the samples horizontally."""
        from torchvision.transforms import v2  # slow to import, and not needed for inference

        return (v2.RandomHorizontalFlip(p=0.5),)

    def pose_network(self) -> PoseNetwork:
        """A new pose network of seven convolutions."""
        return seven_convolution_pose_network()

    def foundation(self) -> Foundation:
        """The inner ScaffNet."""
        return Foundation("scaffnet", self.scaffnet_settings, self.scaffnet)

    def published_modules(self) -> dict[str, nn.Module]:
        """The modules in fusionnet-*.pth, including ScaffNet's."""
        return {
            **self.scaffnet.published_modules(),
            "fusionnet_encoder_image_state_dict": self.encoder_image,
            "fusionnet_encoder_depth_state_dict": self.encoder_depth,
            "fusionnet_decoder_state_dict": self.decoder,
        }


def match_scale(depth: Tensor, points: Tensor, window: int = 5, largest: float = 2.0) -> Tensor:
    """Scale depth near each sparse point so that it agrees with the point.

    Where windows overlap, the larger factor is used; points that would need a factor above `largest` are ignored.

    Args:
        depth: N x 1 x H x W metres, above 0.
        points: N x 1 x H x W metres, 0 = none.
        window: side of the window around a point, pixels, odd.
        largest: largest plausible factor.
    """
    factor = points / depth
    factor = sliding_max(factor.masked_fill(factor > largest, 0.0), window)
    return depth * factor.masked_fill(factor == 0.0, 1.0)
