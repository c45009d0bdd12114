"""Pinhole camera shared by all renderers, maps and models."""

import math
from dataclasses import dataclass

import numpy as np

from deux.errors import check_range
from deux.memory_budget import check_memory

FOCAL_LENGTHS = (1e-3, 1e7)
"""Valid range of focal lengths in pixels; beyond it, projections are dominated by rounding errors."""

_LARGE = 4_000_000  # pixels of a frame above which the available memory is checked
_PIXEL_BYTES = 100  # memory for each pixel of a frame while it is rendered and processed


def is_focal_length(value: float) -> bool:
    """Whether a value in pixels is a valid focal length."""
    return FOCAL_LENGTHS[0] <= value <= FOCAL_LENGTHS[1]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels and pixel centres at integer coordinates.

    Args:
        width: image width in pixels.
        height: image height in pixels.
        hfov: horizontal field of view in degrees.
        min_depth: smallest depth that the sensor measures, metres.
        max_depth: largest depth that the sensor measures, metres; depth beyond it is 0, "none".

    Raises:
        DeuxError: a value is out of range, or a frame does not fit into memory.

    Example:
        >>> Camera(width=4, height=2, hfov=90.0).intrinsics.round(6).tolist()
        [[2.0, 0.0, 1.5], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]]
    """

    width: int = 400
    height: int = 400
    hfov: float = 90.0
    min_depth: float = 0.1
    max_depth: float = 10.0

    def __post_init__(self) -> None:
        check_range("camera.width", self.width, 1)
        check_range("camera.height", self.height, 1)
        if (pixels := self.width * self.height) > _LARGE:
            what = f"a camera of {self.width:,} x {self.height:,} pixels"
            check_memory(_PIXEL_BYTES * pixels, what, "make camera.width and camera.height smaller")
        check_range("camera.hfov", self.hfov, 0, 180, ends=False)
        check_range("camera.min_depth", self.min_depth, 0)
        check_range("camera.max_depth", self.max_depth, self.min_depth, ends=False)

    @property
    def focal_length(self) -> float:
        """Focal length in pixels, f = W / (2 tan(h / 2))."""
        return self.width / (2.0 * math.tan(math.radians(self.hfov) / 2.0))

    @property
    def intrinsics(self) -> np.ndarray:
        """Camera matrix K, 3 x 3 float64, with the principal point at ((W - 1) / 2, (H - 1) / 2)."""
        f = self.focal_length
        return np.array([[f, 0.0, (self.width - 1) / 2], [0.0, f, (self.height - 1) / 2], [0.0, 0.0, 1.0]])

    def rays(self) -> np.ndarray:
        """Ray directions of all pixels in camera axes, H x W x 3 float64 with z = 1, so that a point is ray * depth."""
        k = self.intrinsics
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        return np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(u.shape)], axis=-1)
