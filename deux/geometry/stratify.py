"""Partition of a floor into parts of equal area, for stratified sampling."""

import numpy as np

from deux.errors import DeuxError


def stratify(free: np.ndarray, count: int) -> list[np.ndarray]:
    """Divide the free cells into parts of equal area, by recursively halving them along their longer side.

    Args:
        free: rows x columns bool.
        count: number of parts.

    Returns:
        `count` non-empty arrays of (row, column) pairs, whose sizes differ by one cell at most; with fewer cells than
        parts, several parts consist of the same cell.

    Raises:
        DeuxError: no cell is free.
    """
    cells = np.argwhere(free)
    if not len(cells):
        raise DeuxError("there is no free floor: no positions can be sampled.")

    def divide(part: np.ndarray, pieces: int) -> list[np.ndarray]:
        if pieces == 1 or len(part) < 2:
            return [part] * pieces
        axis = int(np.argmax(np.ptp(part, axis=0)))
        part = part[np.argsort(part[:, axis], kind="stable")]
        first = pieces // 2
        middle = round(len(part) * first / pieces)
        return divide(part[:middle], first) + divide(part[middle:], pieces - first)

    return divide(cells, count)
