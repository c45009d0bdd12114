"""`training.augmentation`: its options, apart from what they make, which brings torchvision."""

from dataclasses import dataclass

from deux.collection.point_patterns import PATTERNS, Pattern
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
        scale: least and greatest factor, drawn log-uniformly for each sample, by which its depth and the way between
            its frames are multiplied: the same pictures of a smaller or larger scene. No sparse point is carried out of
            the depth that the model predicts. Without effect where frames are compared whose poses are not known but
            learned.
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
            raise DeuxError(f"{where}.scale is {list(self.scale)}: it is the least and the greatest factor.")
        if self.density is None:
            if self.noise or self.outliers or self.patterns != PATTERNS:
                raise DeuxError(
                    f"{where}.patterns, noise and outliers are of points that are drawn anew: set {where}.density."
                )
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
