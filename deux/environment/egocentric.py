"""Egocentric crops of an occupancy map, centred on the robot and rotated so that its heading is up."""

from dataclasses import dataclass

import numpy as np

from deux.compilation import compiled
from deux.errors import DeuxError, check_range
from deux.geometry.grid import GridFrame
from deux.mapping.occupancy import FREE, OCCUPIED, UNKNOWN

CHANNELS = ("free", "occupied", "unknown", "visited")
"""Channels of a crop. The value of a pixel is the fraction of its area, 0 to 255."""

SAMPLES = 3
"""Number of map samples along the edge of a pixel."""


@dataclass(frozen=True)
class Crops:
    """Sizes of the near and the far crop.

    Args:
        near: edge of the near crop in metres; exploring_exploration uses 4.
        far: edge of the far crop in metres; exploring_exploration uses 20, which is more than most apartments.
        pixels: edge of each crop in pixels, a multiple of 8. With the default, a pixel of the near crop is a map cell
            and the crops are large enough for the network of stable-baselines3, which needs 36 pixels or more.

    Raises:
        DeuxError: a value is out of range.
    """

    near: float = 4.0
    far: float = 16.0
    pixels: int = 40

    def __post_init__(self) -> None:
        check_range("crops.near", self.near, 0.0, ends=False)
        check_range("crops.far", self.far, 0.0, ends=False)
        if self.pixels < 8 or self.pixels % 8:
            raise DeuxError(
                f"crops.pixels is {self.pixels}: it must be a multiple of 8, since the network downsamples by 8."
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of a crop, channels x rows x columns."""
        return len(CHANNELS), self.pixels, self.pixels


def egocentric_crop(
    occupancy: np.ndarray, visited: np.ndarray, frame: GridFrame, pose: np.ndarray, edge: float, pixels: int
) -> np.ndarray:
    """Crop a square from a map, centred on the robot and with its heading up.

    Args:
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free. The outside of the map is unknown.
        visited: rows x columns bool, the cells where the robot has been.
        frame: grid of both arrays.
        pose: 4 x 4 camera-to-world.
        edge: edge of the square in metres.
        pixels: edge of the square in pixels.

    Returns:
        4 x pixels x pixels uint8, the fraction of the pixel's area for each of `CHANNELS`, times 255.
    """
    forward = pose[[0, 2], 2] / np.hypot(pose[0, 2], pose[2, 2])
    lattice = (frame.origin_x, frame.origin_z, frame.resolution)
    return _crop(occupancy, visited, lattice, (pose[0, 3], pose[2, 3]), (forward[0], forward[1]), edge, pixels)


@compiled(nogil=True)
def _crop(occupancy, visited, lattice, place, forward, edge, pixels):  # type: ignore[no-untyped-def]
    origin_x, origin_z, resolution = lattice
    rows, columns = occupancy.shape
    step = edge / (pixels * SAMPLES)
    counts = np.zeros((4, pixels, pixels), np.int32)
    for v in range(pixels * SAMPLES):
        ahead = edge / 2.0 - (v + 0.5) * step
        for u in range(pixels * SAMPLES):
            right = (u + 0.5) * step - edge / 2.0
            # In the Y-up world, right of the heading (fx, fz) is (-fz, fx).
            x = place[0] + ahead * forward[0] - right * forward[1]
            z = place[1] + ahead * forward[1] + right * forward[0]
            row = int(np.floor((z - origin_z) / resolution))
            column = int(np.floor((x - origin_x) / resolution))
            kind = UNKNOWN
            if 0 <= row < rows and 0 <= column < columns:
                kind = occupancy[row, column]
                if visited[row, column]:
                    counts[3, v // SAMPLES, u // SAMPLES] += 1
            channel = 0 if kind == FREE else (1 if kind == OCCUPIED else 2)
            counts[channel, v // SAMPLES, u // SAMPLES] += 1
    return (counts * 255 // (SAMPLES * SAMPLES)).astype(np.uint8)
