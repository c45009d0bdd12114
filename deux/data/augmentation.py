"""`training.augmentation`: samples with cameras and sparse points other than those of the stored frames.

A model that is to work with any camera and any sensor is trained on samples whose field of view, size and points are
drawn anew each time. The transforms work on the samples of `deux.data.transforms`, beside those that a model brings.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torchvision.transforms import v2
from torchvision.transforms.v2 import functional

from deux.collection.point_patterns import PATTERNS, Pattern, disturb, draw_points
from deux.contracts import Augmentation
from deux.data.transforms import DepthMap, InputSparseDepth, Intrinsics
from deux.errors import DeuxError, check_range

LARGEST_SIZE = 4096
"""Bound of a sample's sides in pixels."""


@dataclass(frozen=True)
class AugmentationSettings:
    """How training samples differ from the stored frames. The defaults leave all to the model's own augmentation.

    Args:
        sizes: height and width in pixels of the samples, one of these for each batch; none keeps the frames' size.
        least_view: smallest part of the frame's height or width, whichever limits it, that is cut out and resized:
            a part p of a field of view h leaves 2 arctan(p tan(h/2)). Drawn uniformly from here to 1 for each sample;
            the window lies anywhere in the frame. The intrinsics follow.
        flip: probability of mirroring left to right.
        colors: strength of changes of brightness, contrast and saturation: each is multiplied by a factor from
            1 - colors to 1 + colors.
        density: least and greatest number of sparse points, as a fraction of the pixels, drawn log-uniformly. They are
            taken from the ground truth, as a sensor would, in place of the stored points. None keeps these.
        patterns: where they lie, one of these for each sample: corners, uniform, grid, lines, clusters.
        noise: greatest relative standard deviation of their depth; drawn uniformly from 0 for each sample.
        outliers: greatest fraction of them that is badly wrong; drawn uniformly from 0 for each sample.
        own: whether the model's own augmentation is applied too, after all this.

    Raises:
        DeuxError: a value is out of its range.
    """

    sizes: tuple[tuple[int, int], ...] = ()
    least_view: float = 1.0
    flip: float = 0.0
    colors: float = 0.0
    density: tuple[float, float] | None = None
    patterns: tuple[Pattern, ...] = PATTERNS
    noise: float = 0.0
    outliers: float = 0.0
    own: bool = True

    def __post_init__(self) -> None:
        where = "training.augmentation"
        for side in (side for size in self.sizes for side in size):
            check_range(f"{where}.sizes", side, 1, LARGEST_SIZE)
        check_range(f"{where}.least_view", self.least_view, 0.05, 1)
        for name in ("flip", "colors", "outliers"):
            check_range(f"{where}.{name}", getattr(self, name), 0, 1)
        check_range(f"{where}.noise", self.noise, 0, 0.5)
        if self.density is None:
            if self.noise or self.outliers:
                raise DeuxError(f"{where}.noise and outliers are of points that are drawn anew: set {where}.density.")
            return
        for density in self.density:
            check_range(f"{where}.density", density, 1e-6, 1)
        if self.density[0] > self.density[1] or not self.patterns:
            raise DeuxError(
                f"{where}.density is {list(self.density)} with the patterns {list(self.patterns)}: it is the least and "
                "the greatest part of the pixels, and there is at least one pattern."
            )

    @property
    def draws_points(self) -> bool:
        """Whether points are taken from the ground truth, which then has to be read."""
        return self.density is not None

    def transforms(self, model: Sequence[Augmentation] = ()) -> list[Augmentation]:
        """The augmentation of a training.

        Args:
            model: the model's own augmentation.
        """
        found: list[Augmentation] = []
        if self.sizes or self.least_view < 1:
            found.append(RandomView(self.sizes, self.least_view))
        if self.flip:
            found.append(v2.RandomHorizontalFlip(self.flip))
        if self.colors:
            found.append(v2.ColorJitter(self.colors, self.colors, self.colors))
        if self.density is not None:
            found.append(DrawPoints(self.density, self.patterns, (0.0, self.noise), (0.0, self.outliers)))
        return [*found, *(model if self.own else ())]


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
