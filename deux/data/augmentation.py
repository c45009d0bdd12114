"""The data augmentation of `training.augmentation`: random field of view, image size, scale and sparse points.

It trains models for cameras and depth sensors other than those of the stored frames. The transforms act on the parts
of a sample (`deux.data.sample_parts`) and are applied before the model's own augmentation.
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
    """Compose the transforms that are applied to training samples, in order.

    Args:
        settings: the options.
        model: the model's own augmentation.
        depth_range: nearest and farthest depth in metres that the model predicts.
        scalable: whether `RandomScale` may be used: the samples have recorded poses, or no source frames. If poses are
            estimated from the images, the scale cannot be observed.
    """
    transforms: list[Augmentation] = []
    if settings.sizes or settings.least_view < 1:
        transforms.append(RandomView(settings.sizes, settings.least_view))
    if settings.flip:
        transforms.append(v2.RandomHorizontalFlip(settings.flip))
    if settings.density is not None:
        noise, outliers = (0.0, settings.noise), (0.0, settings.outliers)
        transforms.append(DrawPoints(settings.density, settings.patterns, noise, outliers))
    if scalable and settings.scale != (1.0, 1.0):  # after DrawPoints: the factors depend on the points' depth
        transforms.append(RandomScale(settings.scale, depth_range))
    if settings.colors:
        transforms.append(v2.ColorJitter(settings.colors, settings.colors, settings.colors))
    return [*transforms, *(model if settings.own else ())]


def fix_batch_size(augmentation: Sequence[Augmentation], seed: int) -> list[Augmentation]:
    """The augmentation for one batch: the image size, which all its samples share, is drawn from the seed."""
    return [one.with_one_size(seed) if isinstance(one, RandomView) else one for one in augmentation]


class RandomView(v2.Transform):
    """Crop a random window, which simulates a narrower field of view, and resize it.

    Args:
        sizes: heights and widths of the result, of which one is drawn for each batch; empty for the frame's size.
        least_view: smallest side of the window relative to the largest window with the result's aspect ratio; the side
            is drawn uniformly from `least_view` to 1.
    """

    def __init__(self, sizes: Sequence[tuple[int, int]] = (), least_view: float = 1.0) -> None:
        super().__init__()
        self.sizes, self.least_view = tuple(sizes), least_view

    def with_one_size(self, seed: int) -> "RandomView":
        """A copy with only one of the sizes, drawn from the seed."""
        if len(self.sizes) < 2:
            return self
        return RandomView([self.sizes[np.random.default_rng(seed).integers(len(self.sizes))]], self.least_view)

    def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
        """Draw the window, and one of the sizes."""
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
    """Multiply depth and the translations between frames by a random factor; the images do not change.

    Photometric errors do not change either: a camera that moves s times as far in a scene s times as large sees the
    same images. The factor is limited such that a sample's nearest and farthest sparse points stay within the depth
    range of the model: points outside of it would bias the predictions towards the ends of the range.

    Args:
        factors: least and greatest factor, drawn log-uniformly for each sample.
        depth_range: nearest and farthest depth in metres that the model predicts.
    """

    def __init__(self, factors: tuple[float, float], depth_range: tuple[float, float] = (0.0, math.inf)) -> None:
        super().__init__()
        self.factors, self.depth_range = factors, depth_range

    def draw_factor(self, span: tuple[float, float] | None, generator: torch.Generator | None = None) -> float:
        """Draw the factor of a sample.

        Args:
            span: depth in metres of its nearest and farthest sparse point; None without points.
            generator: the random generator; by default torch's default generator.
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
        """Scale depth maps and poses; other parts of the sample are returned as they are."""
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
    """Relative poses, S x 4 x 4, with their translations multiplied by a factor."""
    scaled = motions.copy()
    scaled[:, :3, 3] *= factor
    return scaled


class DrawPoints:
    """Replace the sparse points of a sample by points sampled from its ground truth.

    It computes on the CPU: for a sample on a GPU the host waits for a copy.

    Args:
        density: least and greatest number of points as a fraction of the pixels, drawn log-uniformly.
        patterns: spatial distributions of the points, of which one is drawn for each sample.
        noise: least and greatest relative standard deviation of the depth noise, drawn uniformly.
        outliers: least and greatest fraction of points that are outliers, drawn uniformly.
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
        """Replace both sparse depth maps of a sample that has "ground_truth"."""
        rng = np.random.default_rng(int(torch.randint(2**62, ())))  # torch's generator is seeded for each sample
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
