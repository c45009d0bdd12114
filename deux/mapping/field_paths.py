"""Evenly spaced points on the shortest paths to many cells, by descending one distance field."""

import math
from dataclasses import dataclass

import numpy as np

from deux.compilation import compiled


@dataclass(frozen=True)
class PathPoints:
    """Points on the paths to N goals.

    Args:
        goal: M int64 in increasing order, the index of the goal whose path each point lies on; the points of a path are
            ordered from the goal back to the start.
        cells: M x 2 int64 (row, column).
        motion: M x 2 float64 (rows, columns), the displacement to the next point towards the goal.
    """

    goal: np.ndarray
    cells: np.ndarray
    motion: np.ndarray


def points_on_paths(distance: np.ndarray, goals: np.ndarray, spacing: float) -> PathPoints:
    """Points on the shortest paths from a distance field's start to given cells, without the goals themselves.

    Args:
        distance: rows x columns, see `deux.mapping.planning.distance_field`.
        goals: N x 2 int64 (row, column); unreachable ones have no points.
        spacing: path length in cells between points, counted from the goal; each point is the first cell of the path
            at or beyond that length.
    """
    goal, cells, motion = _descend(distance, goals, spacing)
    return PathPoints(goal[1:], cells[1:], motion[1:])


@compiled
def _descend(distance, goals, spacing):  # type: ignore[no-untyped-def]
    """Descend the field from each goal. The first element of each list only defines its type for numba."""
    goal, cells, motion = [0], [(0, 0)], [(0.0, 0.0)]
    for i in range(len(goals)):
        row, column = goals[i, 0], goals[i, 1]
        last_row, last_column, way = row, column, 0.0
        while 0.0 < distance[row, column] < np.inf:
            best_row, best_column, best = row, column, np.inf
            for down in range(-1, 2):
                for right in range(-1, 2):
                    to_row, to_column = row + down, column + right
                    if (down == 0 and right == 0) or not (
                        0 <= to_row < distance.shape[0] and 0 <= to_column < distance.shape[1]
                    ):
                        continue
                    cuts_corner = np.isinf(distance[to_row, column]) or np.isinf(distance[row, to_column])
                    through = distance[to_row, to_column] + math.sqrt(down * down + right * right)
                    if through < best - 1e-9 and not (down != 0 and right != 0 and cuts_corner):
                        best_row, best_column, best = to_row, to_column, through
            way += math.sqrt((best_row - row) ** 2 + (best_column - column) ** 2)
            row, column = best_row, best_column
            if way >= spacing - 1e-9:
                way -= spacing  # the remainder counts towards the next point
                goal.append(i)
                cells.append((row, column))
                motion.append((float(last_row - row), float(last_column - column)))
                last_row, last_column = row, column
    return np.array(goal), np.array(cells), np.array(motion)
