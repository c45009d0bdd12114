"""Dividing a floor into parts of equal area, to spread places evenly over it."""

import numpy as np

from deux.errors import DeuxError


def stratify(free: np.ndarray, count: int) -> list[np.ndarray]:
    """Divide the free cells into parts of equal area, by halving them again and again across their longer side.

    Args:
        free: rows x columns bool.
        count: number of parts.

    Returns:
        `count` arrays of (row, column) pairs, none of them empty; their sizes differ by one cell at most while there
        are enough cells, and with fewer cells than parts some parts are the same single cell.

    Raises:
        DeuxError: no cell is free.
    """
    cells = np.argwhere(free)
    if not len(cells):
        raise DeuxError("there is no free floor: no place can be chosen on it.")

    def divide(part: np.ndarray, pieces: int) -> list[np.ndarray]:
        if pieces == 1 or len(part) < 2:
            return [part] * pieces
        axis = int(np.argmax(np.ptp(part, axis=0)))
        part = part[np.argsort(part[:, axis], kind="stable")]
        first = pieces // 2
        middle = round(len(part) * first / pieces)
        return divide(part[:middle], first) + divide(part[middle:], pieces - first)

    return divide(cells, count)
