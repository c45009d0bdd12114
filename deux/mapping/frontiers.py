"""Frontiers: where known free floor meets the unknown (Yamauchi 1997)."""

import cv2
import numpy as np

from deux.mapping.occupancy import FREE, UNKNOWN


def frontier_mask(cells: np.ndarray) -> np.ndarray:
    """Which cells of an occupancy grid are free and have an unknown 4-neighbour.

    Args:
        cells: rows x columns int8: 0 unknown, 1 occupied, 2 free. What lies outside counts as known.

    Returns:
        rows x columns bool.
    """
    unknown = cells == UNKNOWN
    beside_unknown = np.zeros_like(unknown)
    beside_unknown[1:] |= unknown[:-1]
    beside_unknown[:-1] |= unknown[1:]
    beside_unknown[:, 1:] |= unknown[:, :-1]
    beside_unknown[:, :-1] |= unknown[:, 1:]
    return beside_unknown & (cells == FREE)


def find_frontiers(cells: np.ndarray, min_size: int = 1, without: np.ndarray | None = None) -> list[np.ndarray]:
    """The frontiers of an occupancy grid: 8-connected clusters of frontier cells.

    Args:
        cells: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        min_size: clusters of fewer cells are left out.
        without: rows x columns bool, cells that do not count as frontier cells.

    Returns:
        One N x 2 int64 array of (row, column) for each cluster, the largest first; equal sizes in scan order.
    """
    frontier = frontier_mask(cells)
    if without is not None:
        frontier &= ~without
    rows, columns = np.nonzero(frontier)
    if len(rows) == 0:
        return []
    # Only the part of the grid that holds frontiers is labelled; the arrays are mostly unknown margin.
    top, left = rows.min(), columns.min()
    mask = np.zeros((rows.max() - top + 1, columns.max() - left + 1), np.uint8)
    mask[rows - top, columns - left] = 1
    _, labels = cv2.connectedComponents(mask, connectivity=8)
    label = labels[rows - top, columns - left]
    order = np.argsort(label, kind="stable")
    points = np.stack([rows, columns], axis=1)[order]
    clusters = np.split(points, np.flatnonzero(np.diff(label[order])) + 1)
    clusters = [cluster for cluster in clusters if len(cluster) >= min_size]
    return sorted(clusters, key=lambda cluster: (-len(cluster), *cluster[0]))
