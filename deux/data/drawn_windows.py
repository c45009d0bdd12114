"""Crop, flips, scale and hidden points of a training sample, drawn on the host before pixels are processed.

Crops and flips are sequences of rows and columns, hidden points are lists of pixels, and the scale is one factor. A
batch of such samples is cropped from frames on a GPU in one operation (`deux.data.device_batches`). Other
augmentations are applied to each sample (`deux.data.transforms.augment_tensors`); both give the same samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torchvision.transforms import v2

from deux.contracts import Augmentation
from deux.data.augmentation import RandomScale, scaled_motions
from deux.data.device_cache import StoredFrame
from deux.data.sample_parts import depth_span, mirrored_matrix, mirrored_motions
from deux.data.transforms import DropPoints


@dataclass
class Window:
    """The pixels of one sample, and its camera.

    Args:
        rows: h, rows of the frame from top to bottom of the sample.
        columns: w, columns of the frame from left to right of the sample.
        intrinsics: 3 x 3 float64, the sample's camera matrix.
        motions: S x 4 x 4 float64, source from target; None without poses.
        hidden: indices, among the h w pixels, of the sparse points that are removed from the network's input.
        scale: factor by which the sample's depth is multiplied.
    """

    rows: np.ndarray
    columns: np.ndarray
    intrinsics: np.ndarray
    motions: np.ndarray | None
    hidden: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    scale: float = 1.0

    def mirror(self, axis: int) -> None:
        """Flip the sample along an axis: 0 is x (left to right), 1 is y (top to bottom)."""
        height, width = len(self.rows), len(self.columns)
        row, column = np.divmod(self.hidden, width)
        if axis == 0:
            self.columns, column = self.columns[::-1], width - 1 - column
        else:
            self.rows, row = self.rows[::-1], height - 1 - row
        self.hidden = row * width + column
        self.intrinsics = mirrored_matrix(self.intrinsics, (height, width), axis)
        if self.motions is not None:
            self.motions = mirrored_motions(self.motions, axis)

    def enlarge(self, factor: float) -> None:
        """Multiply all lengths of the sample."""
        self.scale *= factor
        if self.motions is not None:
            self.motions = scaled_motions(self.motions, factor)

    def shown(self, sparse_depth: StoredFrame) -> np.ndarray:
        """The sparse points that are not hidden, as increasing indices of the h w pixels."""
        assert sparse_depth.points is not None
        row, column = np.divmod(sparse_depth.points.pixels.astype(np.int64), sparse_depth.shape[1])
        row, column = _places(self.rows, row), _places(self.columns, column)
        inside = (row >= 0) & (column >= 0)
        there = np.sort(row[inside] * len(self.columns) + column[inside])
        return np.setdiff1d(there, self.hidden, assume_unique=True) if len(self.hidden) else there

    def shown_depth(self, sparse_depth: StoredFrame) -> np.ndarray:
        """Depth in metres of the points that `shown` returns, in the same order."""
        shown = self.shown(sparse_depth)
        assert sparse_depth.points is not None
        row, column = np.divmod(shown, len(self.columns))
        pixels = self.rows[row] * sparse_depth.shape[1] + self.columns[column]
        depth: np.ndarray = sparse_depth.points.depth[np.searchsorted(sparse_depth.points.pixels, pixels)]
        return depth * np.float32(self.scale)


def is_drawn(augmentation: Sequence[Augmentation]) -> bool:
    """Whether an augmentation consists only of flips, `RandomScale` and `DropPoints`, which `draw` supports."""
    known = (v2.RandomHorizontalFlip, v2.RandomVerticalFlip, RandomScale, DropPoints)
    return all(type(transform) in known for transform in augmentation)


def draw(
    window: Window, augmentation: Sequence[Augmentation], generator: torch.Generator, sparse_depth: StoredFrame
) -> None:
    """Apply an augmentation to a window, with the same random numbers as the transforms themselves.

    Args:
        window: the crop, changed in place.
        augmentation: transforms that `is_drawn` accepts.
        generator: the random generator, seeded for this sample.
        sparse_depth: the target's sparse depth.
    """
    for transform in augmentation:
        if isinstance(transform, DropPoints):
            fraction = transform.draw_fraction(generator)
            if fraction > 0.0:
                shown = window.shown(sparse_depth)
                lost = transform.draw_points(len(shown), fraction, generator).numpy()
                window.hidden = np.concatenate([window.hidden, shown[lost]])
        elif isinstance(transform, RandomScale):
            window.enlarge(transform.draw_factor(depth_span(window.shown_depth(sparse_depth)), generator))
        elif float(torch.rand(1, generator=generator)) < np.float32(transform.p):  # type: ignore[attr-defined]
            window.mirror(0 if isinstance(transform, v2.RandomHorizontalFlip) else 1)


def _places(order: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The position of each value in increasing or decreasing consecutive numbers; -1 if it is not among them."""
    place = values - order[0] if order[-1] >= order[0] else order[0] - values
    return np.where((place >= 0) & (place < len(order)), place, -1)
