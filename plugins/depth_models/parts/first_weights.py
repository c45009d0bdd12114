"""Weight initialisation for short trainings: He's normal distribution, with a set mean of the first prediction.

Glorot's distribution, as published, halves the features at every layer without normalisation. Before the output they
are a few hundredths, so that every pixel starts at a logit of 0, a depth of 0.2 m, which a short training has to leave
first, or never does (docs/decisions/0023-first-weights.md).
"""

import math
from typing import Literal

import torch
from torch import Tensor, nn

from deux.contracts import DepthModel
from deux_plugins.depth_models.parts.convolution import Convolution

FirstWeights = Literal["glorot", "he"]
"""Glorot's normal distribution, as in all published trainings, or He's with a set mean of the first prediction."""

OUTPUT_SCALE = 0.3
"""Factor of the random weights of the output layer, so that the set mean dominates the first prediction."""

SLOPE = 0.2
"""Negative slope of the leaky ReLU after each convolution."""


def first_depth(model: DepthModel) -> float:
    """The first prediction after `draw_he_weights` in metres: a quarter of the largest depth, 2.5 m for DEUX's 10 m."""
    return max(model.max_depth / 4.0, math.sqrt(model.min_depth * model.max_depth))


def draw_he_weights(model: DepthModel, output: Convolution) -> None:
    """Draw the weights of all convolutions from He's normal distribution, and set the mean of the first prediction.

    He et al. 2015: standard deviation sqrt(2 / ((1 + slope^2) fan_in)), which preserves the size of features from layer
    to layer. Then the centre tap of the output layer, which alone is not affected by zero padding, is shifted along the
    mean of its input, measured on noise with 1 % random points, such that the mean logit is that of `first_depth`.
    Models on the meta device are not changed.

    Args:
        model: a new model that predicts depth from the logits of its last layer by `depth_from_logits`.
        output: the last layer, with one output channel.
    """
    weight = output.conv.weight
    if weight.is_meta:
        return
    for module in model.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.kaiming_normal_(module.weight, a=SLOPE)
    nearness = model.min_depth / first_depth(model) - model.min_depth / model.max_depth
    logit = math.log(nearness / (1.0 - nearness))
    with torch.no_grad():
        mean = _mean_input(model, output)
        weight.mul_(OUTPUT_SCALE)
        present = (weight.sum(dim=(2, 3))[0] * mean).sum()
        weight[0, :, 1, 1] += (logit - present) * mean / (mean @ mean)


def _mean_input(model: DepthModel, layer: nn.Module) -> Tensor:
    """The mean input of a layer over the inner pixels of two synthetic frames, for each channel."""
    size, border, random = 64, 8, torch.Generator().manual_seed(0)
    image = torch.rand(2, 3, size, size, generator=random)
    points = torch.rand(2, 1, size, size, generator=random) < 0.01
    sparse_depth = points * (0.5 + torch.rand(2, 1, size, size, generator=random)) * first_depth(model)
    camera = torch.tensor([[size / 2, 0.0, (size - 1) / 2], [0.0, size / 2, (size - 1) / 2], [0.0, 0.0, 1.0]])
    captured: list[Tensor] = []
    hook = layer.register_forward_pre_hook(lambda _, inputs: captured.append(inputs[0]))
    training = model.training
    model.eval()
    model(image, sparse_depth, points.float(), camera.expand(2, 3, 3))
    model.train(training)
    hook.remove()
    return captured[0][:, :, border:-border, border:-border].float().mean(dim=(0, 2, 3))
