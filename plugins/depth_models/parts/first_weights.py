"""First weights for short trainings: He's normal distribution, and a first prediction in the middle of the room.

Glorot's distribution, the published start, halves the features at every layer that has no normalisation. Before the
output they are a few hundredths: every pixel begins at a logit of 0, which is a depth of 0.2 m, and a short training is
spent on leaving it, or never does (docs/decisions/0023-first-weights.md).
"""

import math
from typing import Literal

import torch
from torch import Tensor, nn

from deux.contracts import DepthModel
from deux_plugins.depth_models.parts.convolution import Convolution

FirstWeights = Literal["glorot", "he"]
"""Glorot's normal distribution, as in all published trainings, or He's with a set first prediction."""

OUTPUT_SCALE = 0.3
"""Factor of the drawn weights of the output layer, so that the set mean prevails in the first prediction."""

SLOPE = 0.2
"""Of the leaky ReLU after each convolution."""


def first_depth(model: DepthModel) -> float:
    """Metres that `draw_he_weights` makes a model predict at first: a quarter of the farthest, 2.5 m of DEUX's 10 m."""
    return max(model.max_depth / 4.0, math.sqrt(model.min_depth * model.max_depth))


def draw_he_weights(model: DepthModel, output: Convolution) -> None:
    """Draw the weights of all convolutions from He's normal distribution and set the mean of the first prediction.

    He et al. 2015: standard deviation sqrt(2 / ((1 + slope^2) fan_in)), which keeps the size of features from layer to
    layer. The centre tap of the output layer is then moved along the mean of its input, measured on noise and 1 % of
    random points, to where the mean logit is that of `first_depth`: the centre tap alone never meets the zero padding.
    Models without weights (on the meta device) are left alone.

    Args:
        model: newly made, predicts depth from the logits of its last layer by `depth_from_logits`.
        output: that layer, with one output channel.
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
    """Mean input of a layer over the inner pixels of two synthetic frames, one number for each channel."""
    size, border, random = 64, 8, torch.Generator().manual_seed(0)
    image = torch.rand(2, 3, size, size, generator=random)
    points = torch.rand(2, 1, size, size, generator=random) < 0.01
    sparse_depth = points * (0.5 + torch.rand(2, 1, size, size, generator=random)) * first_depth(model)
    camera = torch.tensor([[size / 2, 0.0, (size - 1) / 2], [0.0, size / 2, (size - 1) / 2], [0.0, 0.0, 1.0]])
    seen: list[Tensor] = []
    hook = layer.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    training = model.training
    model.eval()
    model(image, sparse_depth, points.float(), camera.expand(2, 3, 3))
    model.train(training)
    hook.remove()
    return seen[0][:, :, border:-border, border:-border].float().mean(dim=(0, 2, 3))
