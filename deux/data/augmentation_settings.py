"""The options of `training.augmentation`, in a module that does not import torchvision."""

from dataclasses import dataclass

from deux.collection.point_patterns import PATTERNS, Pattern
from deux.errors import DeuxError, check_range

LARGEST_SIZE = 4096
"""Largest height or width of a sample in pixels."""


@dataclass(frozen=True)
class AugmentationSettings:
    """The data augmentation beside the model's own; the defaults change nothing.

    Args:
        sizes: heights and widths of the samples in pixels, of which one is drawn for each batch; empty for the frames'
            size.
        least_view: smallest crop relative to the largest window with the sample's aspect ratio, drawn uniformly from
            `least_view` to 1 for each sample, at a random position, and then resized. A crop of p reduces a field of
            view h to 2 arctan(p tan(h/2)). The intrinsics change accordingly.
        flip: probability of a horizontal flip.
        scale: least and greatest factor, drawn log-uniformly for each sample, by which depth and the translations
            between frames are multiplied, while the images stay the same. The sparse points stay within the depth
            range of the model. Without effect if the objective compares frames and the poses are learned.
        colors: strength of the changes of brightness, contrast and saturation: each is multiplied by a factor from
            1 - colors to 1 + colors.
        density: least and greatest number of sparse points as a fraction of the pixels, drawn log-uniformly. The
            points are sampled from the ground truth and replace the stored points. None keeps the stored points.
        patterns: spatial distributions of the sampled points, of which one is drawn for each sample: corners, uniform,
            grid, lines, clusters.
        noise: greatest relative standard deviation of their depth; drawn uniformly from 0 for each sample.
        outliers: greatest fraction of outliers; drawn uniformly from 0 for each sample.
        own: whether the model's own augmentation is applied afterwards.

    Raises:
        DeuxError: a value is out of its range.
    """

    sizes: tuple[tuple[int, int], ...] = ()
    least_view: float = 1.0
    flip: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)
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
        for factor in self.scale:
            check_range(f"{where}.scale", factor, 0.05, 20)
        if self.scale[0] > self.scale[1]:
            raise DeuxError(f"{where}.scale is {list(self.scale)}: the least factor must come first.")
        if self.density is None:
            if self.noise or self.outliers or self.patterns != PATTERNS:
                raise DeuxError(
                    f"{where}.patterns, noise and outliers apply to points sampled from the ground truth: set "
                    f"{where}.density too."
                )
            return
        for density in self.density:
            check_range(f"{where}.density", density, 1e-6, 1)
        if self.density[0] > self.density[1] or not self.patterns:
            raise DeuxError(
                f"{where}.density is {list(self.density)} with the patterns {list(self.patterns)}: the least fraction "
                "must come first, and at least one pattern is needed."
            )

    @property
    def draws_points(self) -> bool:
        """Whether sparse points are sampled from the ground truth, which then has to be read."""
        return self.density is not None
