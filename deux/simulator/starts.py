"""Random start poses of episodes on the free floor."""

import math

import numpy as np

from deux.errors import DeuxError, sizes
from deux.geometry.grid import FreeSpace

PREFERRED_CLEARANCE = 0.3  # metres; starts keep this distance from obstacles if possible


def random_starts(free_space: FreeSpace, count: int, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Draw random poses, uniformly from the free cells with enough clearance.

    The clearance must be at least `PREFERRED_CLEARANCE`, or the floor's median clearance if that is less.

    Args:
        free_space: the free floor.
        count: number of poses.
        rng: the random generator.

    Returns:
        (x, z, yaw) of each: world metres, anywhere in a free cell, and radians in [-pi, pi).

    Raises:
        DeuxError: no cell is free.
    """
    if not free_space.free.any():
        size = sizes(free_space.free.shape)
        raise DeuxError(f"none of the {size} cells of the free space is free: the robot fits nowhere on this floor.")
    median = float(np.median(free_space.clearance[free_space.free]))
    roomy = free_space.free & (free_space.clearance >= min(PREFERRED_CLEARANCE, median))
    cells = np.argwhere(roomy)[rng.integers(roomy.sum(), size=count)]
    rows, columns = (cells + rng.uniform(-0.5, 0.5, size=cells.shape)).T
    yaws = rng.uniform(-math.pi, math.pi, size=count)
    return [
        (*free_space.frame.centre(row, column), float(yaw))
        for row, column, yaw in zip(rows, columns, yaws, strict=True)
    ]
