"""`training.augmentation`: samples with cameras and sparse points other than those of the stored frames.

A model that is to work with any camera and any sensor is trained on samples whose field of view, size and points are
drawn anew each time. The transforms work on the parts of `deux.data.sample_parts`, beside those that a model brings.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torchvision.transforms import v2
from torchvision.transforms.v2 import functional

from deux.collection.point_patterns import PATTERNS, Pattern, disturb, draw_points
from deux.contracts import Augmentation
from deux.data.augmentation_settings import AugmentationSettings
from deux.data.sample_parts import DepthMap, InputSparseDepth, Intrinsics, SourcePoses


def training_transforms(
    settings: AugmentationSettings,
    model: Sequence[Augmentation] = (),
    depth_range: tuple[float, float] = (0.0, math.inf),
    scalable: bool = True,
) -> list[Augmentation]:
    """The augmentation of a training.

    Args:
        settings: the options.
        model: the model's own augmentation.
        depth_range: nearest and farthest depth in metres that the model predicts.
        scalable: whether the way between the frames of a sample is known, or it is one frame alone; pictures do not
            tell a small scene from a large one.
    """
    found: list[Augmentation] = []
    if settings.sizes or settings.least_view < 1:
        found.append(RandomView(settings.sizes, settings.least_view))
    if settings.flip:
        found.append(v2.RandomHorizontalFlip(settings.flip))
    if settings.density is not None:
        found.append(DrawPoints(settings.density, settings.patterns, (0.0, settings.noise), (0.0, settings.outliers)))
    if scalable and settings.scale != (1.0, 1.0):  # after the points are drawn, which its factors depend on
        found.append(RandomScale(settings.scale, depth_range))
    if settings.colors:
        found.append(v2.ColorJitter(settings.colors, settings.colors, settings.colors))
    return [*found, *(model if settings.own else ())]


def of_batch(augmentation: Sequence[Augmentation], seed: int) -> list[Augmentation]:
    """The augmentation with what one batch has in common, its samples' size, drawn from a seed."""
    return [one.of_batch(seed) if isinstance(one, RandomView) else one for one in augmentation]


class RandomView(v2.Transform):
    """Cut out a window with the shape of the sample to be, as large as a narrower lens would see, and resize it.

    Args:
        sizes: height and width of the result, one of them for each batch; none for the frame's own.
        least_view: smallest part of the largest window of this shape; the part is drawn uniformly from here to 1.
    """

    def __init__(self, sizes: Sequence[tuple[int, int]] = (), least_view: float = 1.0) -> None:
        super().__init__()
        self.sizes, self.least_view = tuple(sizes), least_view

    def of_batch(self, seed: int) -> "RandomView":
        """The same with one size alone."""
        if len(self.sizes) < 2:
            return self
        return RandomView([self.sizes[np.random.default_rng(seed).integers(len(self.sizes))]], self.least_view)

    def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
        """Draw the window, and of several sizes one."""
        height, width = next(part.canvas_size for part in flat_inputs if isinstance(part, Intrinsics))
        choice, part, down, right = torch.rand(4).tolist()
        size = self.sizes[int(choice * len(self.sizes))] if self.sizes else (height, width)
        scale = min(height / size[0], width / size[1]) * (self.least_view + (1 - self.least_view) * part)
        window = max(1, round(scale * size[0])), max(1, round(scale * size[1]))
        top, left = int(down * (height - window[0] + 1)), int(right * (width - window[1] + 1))
        return {"top": top, "left": left, "height": window[0], "width": window[1], "size": list(size)}

    def transform(self, inpt: Any, params: dict[str, Any]) -> Any:
        """Crop and resize one part of the sample."""
        return self._call_kernel(functional.resized_crop, inpt, **params)


class RandomScale(v2.Transform):
    """The same pictures of a smaller or larger scene: depth and the way between frames are multiplied by one factor.

    No photometric error changes by it, as a camera that moves s times as far sees the same of a scene s times as large.
    A sample's factors end where its nearest or its farthest sparse point would leave the depth that the model predicts:
    a network that is shown points there is drawn to the end of its range.

    Args:
        factors: least and greatest factor, drawn log-uniformly for each sample.
        depth_range: nearest and farthest depth in metres that the model predicts.
    """

    def __init__(self, factors: tuple[float, float], depth_range: tuple[float, float] = (0.0, math.inf)) -> None:
        super().__init__()
        self.factors, self.depth_range = factors, depth_range

    def draw_factor(self, span: tuple[float, float] | None, generator: torch.Generator | None = None) -> float:
        """The factor of a sample.

        Args:
            span: depth in metres of its nearest and farthest sparse point; None without points.
            generator: of the draw; by default torch's default one.
        """
        least, greatest = self.factors
        if span is not None:
            near, far = self.depth_range
            least = min(max(least, near / max(span[0], near)), greatest)
            greatest = max(min(greatest, far / min(span[1], far)), least)
        return least * (greatest / least) ** float(torch.rand((), generator=generator))

    def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
        """Draw the factor of this sample."""
        shown = next(part for part in flat_inputs if isinstance(part, InputSparseDepth))
        return {"factor": self.draw_factor(shown.find_span())}

    def transform(self, inpt: Any, params: dict[str, Any]) -> Any:
        """Scale one part of the sample, if it has a length."""
        if isinstance(inpt, SourcePoses):
            motions = scaled_motions(inpt.as_subclass(Tensor).numpy(), params["factor"])
            return torch.from_numpy(motions).as_subclass(SourcePoses)
        if not isinstance(inpt, DepthMap):
            return inpt
        scaled = (inpt.as_subclass(Tensor) * params["factor"]).as_subclass(type(inpt))
        if isinstance(inpt, InputSparseDepth):
            scaled.points = inpt.points
        return scaled


def scaled_motions(motions: np.ndarray, factor: float) -> np.ndarray:
    """The motions, S x 4 x 4, in a world whose lengths are multiplied by a factor."""
    scaled = motions.copy()
    scaled[:, :3, 3] *= factor
    return scaled


class DrawPoints:
    """Take sparse points from the ground truth, in place of those that the sample has.

    It works on the CPU: on a card the host waits for the sample.

    Args:
        density: least and greatest number of points as a fraction of the pixels, drawn log-uniformly.
        patterns: where they lie, one of these for each sample.
        noise: least and greatest relative standard deviation of their depth, drawn uniformly.
        outliers: least and greatest fraction of them that is badly wrong, drawn uniformly.
    """

    def __init__(
        self,
        density: tuple[float, float],
        patterns: Sequence[Pattern] = PATTERNS,
        noise: tuple[float, float] = (0.0, 0.0),
        outliers: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.density, self.patterns = density, tuple(patterns)
        self.noise, self.outliers = noise, outliers

    def __call__(self, sample: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """A sample with "ground_truth"; both of its sparse depth maps are replaced."""
        rng = np.random.default_rng(int(torch.randint(2**62, ())))  # torch's generator is the sample's
        truth = sample["ground_truth"].as_subclass(Tensor)
        image = sample["images"][0].as_subclass(Tensor).permute(1, 2, 0).contiguous()
        least, most = np.log(self.density)
        count = max(1, round(np.exp(rng.uniform(least, most)) * truth.numel()))
        pattern = self.patterns[rng.integers(len(self.patterns))]
        points = draw_points(pattern, image.cpu().numpy(), truth.cpu().numpy(), count, rng)
        points = disturb(points, rng.uniform(*self.noise), rng.uniform(*self.outliers), rng)
        drawn = torch.from_numpy(points).to(truth.device)
        return {
            **sample,
            "sparse_depth": drawn.as_subclass(DepthMap),
            "input_sparse_depth": drawn.clone().as_subclass(InputSparseDepth),
        }
