"""Which pixels of its frames a training sample is made of, drawn on the host before any pixel is touched.

Crops and mirror images are rows and columns in some order, points that are hidden are pixels that are known
beforehand, and another scale is one factor. A batch of such samples is cut out of frames on a card in one operation
(`deux.data.device_batches`). Other augmentations are applied to each sample (`deux.data.transforms.augment_tensors`);
both give the same samples.
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
        rows: h, the frame's rows from top to bottom of the sample.
        columns: w, from left to right.
        intrinsics: 3 x 3 float64, of the sample.
        motions: S x 4 x 4 float64, or None.
        hidden: indices of the h w pixels whose sparse points the network is not shown.
        scale: factor by which the sample's depth is multiplied.
    """

    rows: np.ndarray
    columns: np.ndarray
    intrinsics: np.ndarray
    motions: np.ndarray | None
    hidden: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    scale: float = 1.0

    def mirror(self, axis: int) -> None:
        """Turn the sample over: axis 0 is x, left to right, and axis 1 is y."""
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
        """The sample's sparse points that are not hidden, as increasing indices of the h w pixels."""
        assert sparse_depth.points is not None
        row, column = np.divmod(sparse_depth.points.pixels.astype(np.int64), sparse_depth.shape[1])
        row, column = _places(self.rows, row), _places(self.columns, column)
        inside = (row >= 0) & (column >= 0)
        there = np.sort(row[inside] * len(self.columns) + column[inside])
        return np.setdiff1d(there, self.hidden, assume_unique=True) if len(self.hidden) else there

    def shown_depth(self, sparse_depth: StoredFrame) -> np.ndarray:
        """Depth in metres of the points that `shown` finds, in the same order."""
        shown = self.shown(sparse_depth)
        assert sparse_depth.points is not None
        row, column = np.divmod(shown, len(self.columns))
        pixels = self.rows[row] * sparse_depth.shape[1] + self.columns[column]
        depth: np.ndarray = sparse_depth.points.depth[np.searchsorted(sparse_depth.points.pixels, pixels)]
        return depth * np.float32(self.scale)


def is_drawn(augmentation: Sequence[Augmentation]) -> bool:
    """Whether an augmentation consists of flips, scales and dropped points alone, for which `draw` suffices."""
    known = (v2.RandomHorizontalFlip, v2.RandomVerticalFlip, RandomScale, DropPoints)
    return all(type(transform) in known for transform in augmentation)


def draw(
    window: Window, augmentation: Sequence[Augmentation], generator: torch.Generator, sparse_depth: StoredFrame
) -> None:
    """Change a window as the augmentation changes a sample, with the same draws.

    Args:
        window: of the crop, without augmentation.
        augmentation: for which `is_drawn` holds.
        generator: seeded for this sample.
        sparse_depth: of the target.
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
    """Where each value stands among consecutive numbers that rise or fall; -1 if it is not one of them."""
    place = values - order[0] if order[-1] >= order[0] else order[0] - values
    return np.where((place >= 0) & (place < len(order)), place, -1)
