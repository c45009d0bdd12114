"""VOICED: unsupervised depth completion from visual inertial odometry (Wong et al., RA-L 2020)."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from deux.contracts import DepthModel, LossSettings, Prediction
from deux.geometry.scaffolding import interpolate
from deux_plugins.depth_models.parts.decoder import Decoder
from deux_plugins.depth_models.parts.depth_range import check_depth_range, depth_from_nearness, nearness_from_logits
from deux_plugins.depth_models.parts.levels import LEVELS, check_levels, joined, sizes
from deux_plugins.depth_models.parts.margin import check_margin, crop, repeat_edge, surround_with_zeros
from deux_plugins.depth_models.parts.pose_network import PoseNetwork, seven_convolution_pose_network
from deux_plugins.depth_models.parts.vgg_encoder import VGG8, VGG11, VGGEncoder


class VOICED(DepthModel):
    """Refines a scaffolding, the linear interpolation of the sparse points, by the image.

    Image and depth have separate encoders; the decoder's output has half the size. The defaults are the published VOID
    settings, with DEUX's depth range. Works at any image size.

    Args:
        encoder: the published vggnet11 or the smaller vggnet08.
        image_filters: channels of the image encoder at its five levels.
        depth_filters: channels of the depth encoder at its five levels.
        decoder_filters: channels of the decoder's four levels.
        min_depth: nearest predicted depth in metres.
        max_depth: farthest predicted depth in metres.
        margin: see KBNet: in evaluation, images are padded by this many pixels, and depth is cropped. 0 is the
            published network.
    """

    objective: ClassVar[LossSettings] = {
        "color_consistency": {"weight": 0.20, "skip_points": True},
        "structural_consistency": {"weight": 0.80, "skip_points": True},
        "sparse_depth": 0.50,
        "local_smoothness": 2.0,
        "pose_consistency": 0.10,
    }

    published_options: ClassVar[Mapping[str, Any]] = {"margin": 0}

    def __init__(
        self,
        encoder: Literal["vggnet08", "vggnet11"] = "vggnet11",
        image_filters: tuple[int, ...] = (48, 96, 192, 384, 384),
        depth_filters: tuple[int, ...] = (16, 32, 64, 128, 128),
        decoder_filters: tuple[int, ...] = (256, 128, 128, 64),
        min_depth: float = 0.1,
        max_depth: float = 10.0,
        margin: int = 0,
    ) -> None:
        super().__init__()
        check_depth_range(min_depth, max_depth)
        check_levels(image_filters=image_filters, depth_filters=depth_filters)
        check_levels(levels=LEVELS - 1, decoder_filters=decoder_filters)
        self.min_depth = min_depth
        self.max_depth = max_depth
        check_margin(margin)
        self.margin = margin
        convolutions = VGG11 if encoder == "vggnet11" else VGG8
        self.encoder_image = VGGEncoder(3, image_filters, convolutions)
        self.encoder_depth = VGGEncoder(2, depth_filters, convolutions)
        channels = [image + depth for image, depth in zip(image_filters, depth_filters, strict=True)]
        self.decoder = Decoder(channels[4], channels[3::-1], decoder_filters)

    def prepare(self, sparse_depth: np.ndarray) -> dict[str, np.ndarray]:
        """Compute the scaffolding, 1 x H x W metres; 0 outside of the points' convex hull, as published."""
        return {"scaffolding": interpolate(sparse_depth, outside="zero")[None]}

    def forward(
        self, image: Tensor, sparse_depth: Tensor, validity: Tensor, intrinsics: Tensor, **prepared: Tensor
    ) -> Prediction:
        """Predict dense depth; see `DepthModel.forward`. As published, the input includes outliers."""
        points = (sparse_depth > 0).to(sparse_depth.dtype)
        scaffolding = prepared["scaffolding"]
        margin = 0 if self.training else self.margin
        if margin:
            image, scaffolding = repeat_edge(image, margin), repeat_edge(scaffolding, margin)
            points = surround_with_zeros(points, margin)
        depth_inputs = torch.cat([scaffolding, points], dim=1)
        features = joined(self.encoder_image(image), self.encoder_depth(depth_inputs))
        *skips, latent = features
        logits = self.decoder(latent, [[skip] for skip in reversed(skips)], sizes(features))
        nearness = functional.interpolate(nearness_from_logits(logits), image.shape[2:], mode="bilinear")
        return Prediction(depth_from_nearness(crop(nearness, margin), self.min_depth, self.max_depth))

    def pose_network(self) -> PoseNetwork:
        """A new pose network of seven convolutions."""
        return seven_convolution_pose_network()

    def published_modules(self) -> dict[str, nn.Module]:
        """The modules in voiced-*.pth."""
        return {
            "encoder_image_state_dict": self.encoder_image,
            "encoder_depth_state_dict": self.encoder_depth,
            "decoder_state_dict": self.decoder,
        }
