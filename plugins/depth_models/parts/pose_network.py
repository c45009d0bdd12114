"""The published pose networks, which predict the relative pose of two images."""

import torch
from torch import Tensor, nn

from deux_plugins.depth_models.parts.convolution import Convolution
from deux_plugins.depth_models.parts.pose_matrix import pose_matrix

POSE_SCALE = 0.01
"""Scale of the six outputs, so that an untrained network predicts almost no motion."""


class PoseNetwork(nn.Module):
    """Encodes two images into a map of six channels, whose mean is the pose vector.

    Args:
        encoder: maps N x 6 x H x W to N x 256 x h x w.
        decoder: maps the features to the pose vector.
    """

    def __init__(self, encoder: nn.Module, decoder: "PoseDecoder") -> None:
        super().__init__()
        self.encoder = encoder
        self.decoder = decoder

    def forward(self, target_image: Tensor, source_image: Tensor) -> Tensor:
        """Predict the relative pose.

        Args:
            target_image: N x 3 x H x W in [0, 1].
            source_image: N x 3 x H x W.

        Returns:
            N x 4 x 4 float32, transforms points of the target camera to the source camera.
        """
        features = self.encoder(torch.cat([target_image, source_image], dim=1))
        return pose_matrix(POSE_SCALE * self.decoder(features))

    def published_modules(self) -> dict[str, nn.Module]:
        """The modules by the names of their state dictionaries in the published pose checkpoint."""
        return {"encoder_state_dict": self.encoder, "decoder_state_dict": self.decoder}


class PoseDecoder(nn.Module):
    """Convolutions of stride 2, then the mean over the image of a 1 x 1 convolution to six channels.

    Args:
        channels: channels of the encoder's output and of the convolutions.
        convolutions: number of convolutions of stride 2 before the last one.
    """

    def __init__(self, channels: int = 256, convolutions: int = 0) -> None:
        super().__init__()
        last = Convolution(channels, 6, kernel=1, activation="linear")
        before = (
            Convolution(channels, channels, stride=2, activation="relu", batch_norm=True) for _ in range(convolutions)
        )
        # The published names differ: conv.<index> for several convolutions, conv for a single one.
        self.conv = nn.Sequential(*before, last) if convolutions else last

    def forward(self, x: Tensor) -> Tensor:
        """N x channels x H x W to N x 6 float32.

        The mean and the last convolution are both linear, so the mean is computed first, which is cheaper. Everything
        is computed in float32, also under autocast, for the precision of the pose, and because oneDNN's bfloat16
        gradients of convolutions of stride 2 are not finite on maps of a single pixel (PyTorch 2.15).
        """
        *before, last = self.conv if isinstance(self.conv, nn.Sequential) else [self.conv]
        with torch.autocast(x.device.type, enabled=False):
            x = x.float()
            for layer in before:
                x = layer(x)
            return last(x.mean(dim=(2, 3), keepdim=True)).flatten(1)


class SevenConvolutionEncoder(nn.Module):
    """Seven convolutions of stride 2 with batch normalisation and ReLU (VOICED, FusionNet)."""

    kernels = (7, 5, 3, 3, 3, 3, 3)
    filters = (16, 32, 64, 128, 256, 256, 256)

    def __init__(self) -> None:
        super().__init__()
        channels = 6
        for i, (kernel, width) in enumerate(zip(self.kernels, self.filters, strict=True), start=1):
            layer = Convolution(channels, width, kernel, stride=2, activation="relu", batch_norm=True)
            self.add_module(f"conv{i}", layer)
            channels = width

    def forward(self, x: Tensor) -> Tensor:
        """N x 6 x H x W to N x 256 x H / 128 x W / 128."""
        for layer in self.children():
            x = layer(x)
        return x


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions and a shortcut, which is projected if the shape changes."""

    def __init__(self, in_channels: int, out_channels: int, stride: int) -> None:
        super().__init__()
        self.conv1 = Convolution(in_channels, out_channels, stride=stride, activation="relu", batch_norm=True)
        self.conv2 = Convolution(out_channels, out_channels, activation="relu", batch_norm=True)
        self.projection = Convolution(in_channels, out_channels, kernel=1, stride=stride, activation="linear")
        self.projects = stride != 1 or in_channels != out_channels
        # The published checkpoints contain a projection in every block; unused ones are not trained.
        self.projection.requires_grad_(self.projects)

    def forward(self, x: Tensor) -> Tensor:
        """N x in_channels x H x W to N x out_channels x H' x W'."""
        shortcut = self.projection(x) if self.projects else x
        return torch.relu(self.conv2(self.conv1(x)) + shortcut)


class ResidualEncoder(nn.Module):
    """A small ResNet18: a 7 x 7 convolution, max pooling, four stages of two blocks (KBNet)."""

    filters = (16, 32, 64, 128, 256)

    def __init__(self) -> None:
        super().__init__()
        first, *others = self.filters
        self.conv1 = Convolution(6, first, kernel=7, stride=2, activation="relu", batch_norm=True)
        self.max_pool = nn.MaxPool2d(3, stride=2, padding=1)
        channels = first
        self.stages = [f"blocks{i}" for i in range(2, 6)]
        for stage, width in zip(self.stages, others, strict=True):
            stride = 1 if stage == "blocks2" else 2
            blocks = nn.Sequential(ResidualBlock(channels, width, stride), ResidualBlock(width, width, 1))
            self.add_module(stage, blocks)
            channels = width

    def forward(self, x: Tensor) -> Tensor:
        """N x 6 x H x W to N x 256 x H / 32 x W / 32."""
        x = self.max_pool(self.conv1(x))
        for stage in self.stages:
            x = self.get_submodule(stage)(x)
        return x


def residual_pose_network() -> PoseNetwork:
    """KBNet's pose network, 4,063,104 parameters."""
    return PoseNetwork(ResidualEncoder(), PoseDecoder(convolutions=2))


def seven_convolution_pose_network() -> PoseNetwork:
    """VOICED's and FusionNet's pose network, 1,587,776 parameters."""
    return PoseNetwork(SevenConvolutionEncoder(), PoseDecoder())
