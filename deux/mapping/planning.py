"""Shortest paths over a grid: A* (Hart et al. 1968) to one goal, distance fields (Dijkstra) to all cells.

Both move to the 8 neighbours at cost 1 or sqrt(2), and diagonally only where both cells beside the step are
traversable: a body with a radius cannot cut a corner.
"""

import heapq
import math

import numpy as np

from deux.compilation import compiled

_SQRT2 = math.sqrt(2.0)


def shortest_path(traversable: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> np.ndarray | None:
    """The shortest path between two cells.

    Args:
        traversable: rows x columns bool.
        start: (row, column) inside the grid.
        goal: (row, column) inside the grid.

    Returns:
        N x 2 int64 (row, column) from start to goal, both included; None if there is no path or if either end is
        not traversable.
    """
    path = _astar(np.ascontiguousarray(traversable), start[0], start[1], goal[0], goal[1])
    return path if len(path) else None


def distance_field(traversable: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    """Length of the shortest path from one cell to every other.

    Args:
        traversable: rows x columns bool.
        start: (row, column) inside the grid.

    Returns:
        rows x columns float64 in units of a cell's edge, inf where no path leads.
    """
    return _distances(np.ascontiguousarray(traversable), start[0], start[1])


def path_length(path: np.ndarray) -> float:
    """Length of an N x 2 path in the units of its coordinates."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@compiled
def line_is_clear(traversable: np.ndarray, start: tuple[int, int], end: tuple[int, int]) -> bool:
    """Whether every cell under the straight line between two cells' centres is traversable."""
    rows, columns = end[0] - start[0], end[1] - start[1]
    pieces = 4 * max(abs(rows), abs(columns), 1)
    for i in range(pieces + 1):
        row = math.floor(start[0] + 0.5 + rows * i / pieces)
        column = math.floor(start[1] + 0.5 + columns * i / pieces)
        if not traversable[row, column]:
            return False
    return True


@compiled
def _may_step(traversable, row, column, down, right):  # type: ignore[no-untyped-def]
    """Whether the step from (row, column) stays inside, on traversable cells, and cuts no corner."""
    to_row, to_column = row + down, column + right
    if not (0 <= to_row < traversable.shape[0] and 0 <= to_column < traversable.shape[1]):
        return False
    if not traversable[to_row, to_column]:
        return False
    return down == 0 or right == 0 or (traversable[to_row, column] and traversable[row, to_column])


@compiled
def _octile(rows, columns):  # type: ignore[no-untyped-def]
    """Length of the shortest obstacle-free path over a displacement in cells."""
    return max(rows, columns) + (_SQRT2 - 1.0) * min(rows, columns)


@compiled
def _astar(traversable, start_row, start_column, goal_row, goal_column):  # type: ignore[no-untyped-def]
    """N x 2 path, empty if there is none."""
    rows, columns = traversable.shape
    start, goal = start_row * columns + start_column, goal_row * columns + goal_column
    if not (traversable[start_row, start_column] and traversable[goal_row, goal_column]):
        return np.empty((0, 2), np.int64)
    cost = np.full(rows * columns, np.inf)
    parent = np.full(rows * columns, -1, np.int32)
    closed = np.zeros(rows * columns, np.bool_)
    cost[start] = 0.0
    queue = [(_octile(abs(goal_row - start_row), abs(goal_column - start_column)) * 1.0, start)]
    while queue:
        _, cell = heapq.heappop(queue)
        if cell == goal:
            break
        if closed[cell]:
            continue
        closed[cell] = True
        row, column = cell // columns, cell % columns
        for down in range(-1, 2):
            for right in range(-1, 2):
                if (down == 0 and right == 0) or not _may_step(traversable, row, column, down, right):
                    continue
                neighbour = cell + down * columns + right
                through = cost[cell] + (_SQRT2 if down != 0 and right != 0 else 1.0)
                if through < cost[neighbour] - 1e-9:
                    cost[neighbour] = through
                    parent[neighbour] = cell
                    ahead = _octile(abs(goal_row - row - down), abs(goal_column - column - right))
                    heapq.heappush(queue, (through + ahead, neighbour))
    if not np.isfinite(cost[goal]):
        return np.empty((0, 2), np.int64)
    count, cell = 1, goal
    while cell != start:
        cell = parent[cell]
        count += 1
    path = np.empty((count, 2), np.int64)
    cell = goal
    for i in range(count - 1, -1, -1):
        path[i, 0], path[i, 1] = cell // columns, cell % columns
        cell = parent[cell]
    return path


@compiled
def _distances(traversable, start_row, start_column):  # type: ignore[no-untyped-def]
    """Distances from the start to all cells, rows x columns.

    Dijkstra's algorithm with buckets one cell wide in place of a priority queue (Dial 1969). No step is shorter than a
    bucket is wide, so the distances in the lowest bucket are final in whatever order they are taken (Dinic 1978), and
    none is longer than two buckets, so three are enough.
    """
    rows, columns = traversable.shape
    width = columns + 2  # a border of cells that are not traversable spares the question whether a step stays inside
    open_cells = np.zeros((rows + 2) * width, np.bool_)
    for row in range(rows):
        open_cells[(row + 1) * width + 1 : (row + 2) * width - 1] = traversable[row]
    distance = np.full((rows + 2) * width, np.inf)
    start = (start_row + 1) * width + start_column + 1
    lowest, second, third = [start], [start], [start]
    second.clear()
    third.clear()
    if open_cells[start]:
        distance[start] = 0.0
    else:
        lowest.clear()
    level = 0
    while len(lowest) + len(second) + len(third) > 0:
        for cell in lowest:
            here = distance[cell]
            if here < level:  # a shorter way was found after the cell had been put in this bucket
                continue
            for ahead, side in ((-width, 1), (1, width), (width, -1), (-1, -width)):
                if not open_cells[cell + ahead]:
                    continue
                if here + 1.0 < distance[cell + ahead]:
                    distance[cell + ahead] = here + 1.0
                    second.append(cell + ahead)
                # Each straight step is followed by the diagonal one clockwise of it.
                diagonal = cell + ahead + side
                if open_cells[cell + side] and open_cells[diagonal] and here + _SQRT2 < distance[diagonal]:
                    distance[diagonal] = here + _SQRT2
                    if here + _SQRT2 < level + 2:
                        second.append(diagonal)
                    else:
                        third.append(diagonal)
        lowest.clear()
        lowest, second, third = second, third, lowest
        level += 1
    return distance.reshape(rows + 2, width)[1:-1, 1:-1].copy()
