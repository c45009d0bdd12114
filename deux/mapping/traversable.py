"""Traversable cells of an occupancy map (`ProcessMap` of Algorithm 1)."""

import math

import cv2
import numpy as np

from deux.compilation import compiled
from deux.mapping.occupancy import FREE, OCCUPIED, UNKNOWN
from deux.mapping.planning import line_is_clear


def disc(radius: float) -> np.ndarray:
    """A square uint8 kernel of odd size, 1 where a cell's centre is within `radius` cells of the middle."""
    reach = math.floor(radius)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return (rows**2 + columns**2 <= radius**2).astype(np.uint8)


def process_map(
    cells: np.ndarray, clearance: float, around: list[tuple[int, int]], unknown_is_traversable: bool = False
) -> np.ndarray:
    """The cells through which paths of the robot's centre may lead.

    Obstacles are dilated by `clearance`. Around given cells the dilation is undone, but obstacles remain: the robot can
    be nearer to a wall than the map allows.

    Args:
        cells: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        clearance: the robot's radius and a safety margin, in cells.
        around: cells (row, column) around which the dilation is undone, within `clearance` + 1 cells.
        unknown_is_traversable: treat unknown cells as free.

    Returns:
        rows x columns bool.
    """
    occupied = (cells == OCCUPIED).astype(np.uint8)
    traversable = cv2.dilate(occupied, disc(clearance)) == 0
    reach = math.ceil(clearance) + 1
    for row, column in around:
        window = np.s_[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
        traversable[window] |= occupied[window] == 0
    if not unknown_is_traversable:
        traversable &= cells != UNKNOWN
    return traversable


@compiled
def approaches(
    open_cells: np.ndarray, distance: np.ndarray, cells: np.ndarray, reach: int
) -> tuple[np.ndarray, np.ndarray]:
    """For each cell, the nearest reachable cell from which it is visible.

    The cell itself may be unreachable, as frontier cells are that are too close to an obstacle.

    Args:
        open_cells: rows x columns bool, true where nothing blocks the view.
        distance: rows x columns float64, path length from the robot, inf if unreachable.
        cells: N x 2 int64 (row, column).
        reach: maximal distance from a cell, in cells.

    Returns:
        N x 2 int64 (row, column), and N float64: the path length there, inf if there is no such cell within reach.
    """
    places = np.zeros((len(cells), 2), np.int64)
    lengths = np.full(len(cells), np.inf)
    for i in range(len(cells)):
        nearest = reach * reach
        goal = (cells[i, 0], cells[i, 1])
        for row in range(max(0, goal[0] - reach), min(distance.shape[0], goal[0] + reach + 1)):
            for column in range(max(0, goal[1] - reach), min(distance.shape[1], goal[1] + reach + 1)):
                length = distance[row, column]
                apart = (row - goal[0]) ** 2 + (column - goal[1]) ** 2
                better = apart < nearest or (apart == nearest and length < lengths[i])
                if np.isfinite(length) and better and line_is_clear(open_cells, (row, column), goal):
                    nearest = apart
                    places[i, 0], places[i, 1] = row, column
                    lengths[i] = length
    return places, lengths


def unknown_beside(cells: np.ndarray, row: int, column: int, reach: int) -> tuple[float, float] | None:
    """Mean (row, column) of the unknown cells within `reach` cells of a cell that have a free 4-neighbour.

    It is the point to look at from a frontier; None if there is no such cell.
    """
    top, left = max(0, row - reach), max(0, column - reach)
    patch = cells[top : row + reach + 1, left : column + reach + 1]
    free = np.pad(patch == FREE, 1)
    beside_free = free[:-2, 1:-1] | free[2:, 1:-1] | free[1:-1, :-2] | free[1:-1, 2:]
    rows, columns = np.nonzero((patch == UNKNOWN) & beside_free)
    return (float(rows.mean()) + top, float(columns.mean()) + left) if len(rows) else None
