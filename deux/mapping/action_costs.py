"""Least number of actions, turns included, from the robot's pose to places on the map: Dijkstra on (cell, heading)."""

import math
from dataclasses import dataclass

import numpy as np

from deux.compilation import compiled
from deux.contracts import Robot
from deux.geometry.grid import GridFrame
from deux.geometry.poses import yaw_of
from deux.mapping.navigation import heading_error
from deux.mapping.planning import line_is_clear

# The 16 moves of the lattice, in cells (down, right), from yaw 0 (towards -z, up) on to the left: 8 neighbours and 8
# knight's moves. Length and direction of the straight lines are off by at most 2.8 % and 13 degrees.
_MOVES = np.array(
    [
        (-1, 0), (-2, -1), (-1, -1), (-1, -2), (0, -1), (1, -2), (1, -1), (2, -1),
        (1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1),
    ]
)  # fmt: skip
_YAWS = np.arctan2(-_MOVES[:, 1], -_MOVES[:, 0]) % (2.0 * math.pi)


@dataclass(frozen=True)
class ActionCosts:
    """Least numbers of actions from one pose to all reachable places; computed by `action_costs`.

    Args:
        field: rows x columns x 16 float64 over the lattice: actions to reach a lattice cell with each heading.
        spacing: lattice spacing in cells of the map.
        traversable: rows x columns bool, the map that was searched.
        frame: the map's frame.
        pose: 4 x 4, the camera-to-world matrix of the start.
        robot: its forward step and turn angle.
    """

    field: np.ndarray
    spacing: int
    traversable: np.ndarray
    frame: GridFrame
    pose: np.ndarray
    robot: Robot

    def to(self, cells: np.ndarray) -> np.ndarray:
        """Least actions to reach N x 2 cells (row, column) with any heading, N float64; inf if unreachable."""
        rows, columns = np.asarray(cells).T
        best = self.field[rows // self.spacing, columns // self.spacing].min(axis=1)
        best[~self.traversable[rows, columns]] = np.inf
        straight = self._straight(cells)[0]
        return np.where(np.isfinite(straight), straight, best)

    def to_views(self, cells: np.ndarray, headings: np.ndarray) -> np.ndarray:
        """Least actions to reach N x 2 cells (row, column) with N yaws in radians, N float64; inf if unreachable."""
        rows, columns = np.asarray(cells).T
        turns = _turns(np.asarray(headings)[:, None] - _YAWS, self.robot)
        best = (self.field[rows // self.spacing, columns // self.spacing] + turns).min(axis=1)
        best[~self.traversable[rows, columns]] = np.inf
        straight, yaws = self._straight(cells)
        return np.minimum(best, straight + _turns(headings - yaws, self.robot))

    def _straight(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Actions of one turn and a straight line, inf if that is blocked, and the yaw on arrival.

        These are exact, while the lattice has only 16 directions.
        """
        frame, x, z = self.frame, float(self.pose[0, 3]), float(self.pose[2, 3])
        rows, columns = np.asarray(cells).T
        to_x = frame.origin_x + (columns + 0.5) * frame.resolution
        to_z = frame.origin_z + (rows + 0.5) * frame.resolution
        errors = heading_error(self.pose, to_x, to_z)
        here = np.array(frame.cell(x, z))
        there = here == np.array([rows, columns]).T
        errors = np.where(there.all(axis=1), 0.0, errors)
        actions = _turns(errors, self.robot) + np.hypot(to_x - x, to_z - z) / self.robot.forward_step
        actions[there.all(axis=1)] = 0.0
        clear = _clear_lines(self.traversable, here, np.ascontiguousarray(cells, np.int64))
        return np.where(clear, actions, np.inf), yaw_of(self.pose) + errors


def action_costs(
    traversable: np.ndarray, frame: GridFrame, pose: np.ndarray, robot: Robot, spacing: float = 0.2
) -> ActionCosts:
    """Find the least number of actions from a pose to every place; forward steps and turns count as one action each.

    The state is a cell of a lattice and one of 16 headings; a turn to the next heading costs its angle over
    `robot.turn_angle`, a move straight ahead its length over `robot.forward_step`, both as fractional actions. A
    lattice cell is traversable if any of its map cells is. Two adjacent lattice cells are connected if traversable map
    cells touch across their border, so that narrow passages are kept; other moves need a clear straight line.

    Args:
        traversable: rows x columns bool, the cells that the robot's centre may enter, see `process_map`.
        frame: its frame.
        pose: 4 x 4 camera-to-world, the start.
        robot: its forward step and turn angle.
        spacing: lattice spacing in metres, rounded to whole cells.
    """
    traversable = np.ascontiguousarray(traversable)
    factor = max(1, round(spacing / frame.resolution))
    here = frame.cell(float(pose[0, 3]), float(pose[2, 3]))
    start_turns = _turns(_YAWS - yaw_of(pose), robot)
    metres = factor * frame.resolution
    move_costs = np.hypot(_MOVES[:, 0], _MOVES[:, 1]) * metres / robot.forward_step
    turn_costs = _turns(np.roll(_YAWS, -1) - _YAWS, robot)
    representatives = _representatives(traversable, factor)
    field = _search(traversable, representatives, factor, here[0], here[1], start_turns, move_costs, turn_costs, _MOVES)
    return ActionCosts(field, factor, traversable, frame, pose, robot)


def _turns(angles: np.ndarray, robot: Robot) -> np.ndarray:
    """Number of turns, as fractional actions, for angles in radians."""
    return np.degrees(np.abs((angles + math.pi) % (2.0 * math.pi) - math.pi)) / robot.turn_angle


@compiled
def _clear_lines(traversable, here, cells):  # type: ignore[no-untyped-def]
    """Whether the straight line from a cell to each of N x 2 cells is traversable."""
    clear = np.zeros(len(cells), np.bool_)
    for i in range(len(cells)):
        clear[i] = line_is_clear(traversable, (here[0], here[1]), (cells[i, 0], cells[i, 1]))
    return clear


@compiled
def _representatives(traversable, factor):  # type: ignore[no-untyped-def]
    """For each lattice cell its open map cell nearest to the middle, rows x columns x 2; -1 where there is none."""
    rows, columns = traversable.shape
    shape = ((rows + factor - 1) // factor, (columns + factor - 1) // factor)
    found = np.full((shape[0], shape[1], 2), -1, np.int64)
    nearest = np.full(shape, np.inf)
    middle = (factor - 1) / 2.0
    for row in range(rows):
        for column in range(columns):
            if traversable[row, column]:
                apart = (row % factor - middle) ** 2 + (column % factor - middle) ** 2
                if apart < nearest[row // factor, column // factor]:
                    nearest[row // factor, column // factor] = apart
                    found[row // factor, column // factor, 0] = row
                    found[row // factor, column // factor, 1] = column
    return found


@compiled
def _touch(traversable, factor, row, column, down, right):  # type: ignore[no-untyped-def]
    """Whether lattice cell (row, column) and its neighbour at (down, right) have open map cells side by side."""
    for i in range(factor):
        if down != 0:
            from_row = row * factor + (factor - 1 if down > 0 else 0)
            from_column = column * factor + i
        else:
            from_row = row * factor + i
            from_column = column * factor + (factor - 1 if right > 0 else 0)
        to_row, to_column = from_row + down, from_column + right
        inside = 0 <= to_row < traversable.shape[0] and 0 <= to_column < traversable.shape[1]
        inside = inside and from_row < traversable.shape[0] and from_column < traversable.shape[1]
        if inside and traversable[from_row, from_column] and traversable[to_row, to_column]:
            return True
    return False


@compiled
def _may_move(traversable, representatives, factor, row, column, down, right):  # type: ignore[no-untyped-def]
    """Whether the robot may go from lattice cell (row, column) by (down, right) cells."""
    to_row, to_column = row + down, column + right
    if not (0 <= to_row < representatives.shape[0] and 0 <= to_column < representatives.shape[1]):
        return False
    if representatives[to_row, to_column, 0] < 0:
        return False
    if abs(down) + abs(right) == 1:
        return _touch(traversable, factor, row, column, down, right)
    start, end = representatives[row, column], representatives[to_row, to_column]
    return line_is_clear(traversable, (start[0], start[1]), (end[0], end[1]))


@compiled
def _put(heads, after, before, state, old, new):  # type: ignore[no-untyped-def]
    """Move a state from bucket `old` (-1: it is in none) to the front of bucket `new` (-1: to none)."""
    if old >= 0:
        if before[state] >= 0:
            after[before[state]] = after[state]
        else:
            heads[old] = after[state]
        if after[state] >= 0:
            before[after[state]] = before[state]
    if new >= 0:
        before[state] = -1
        after[state] = heads[new]
        if heads[new] >= 0:
            before[heads[new]] = state
        heads[new] = state


@compiled
def _search(traversable, representatives, factor, row, column, start_turns, move_costs, turn_costs, moves):  # type: ignore[no-untyped-def]
    """Fewest actions to each lattice cell with each heading, rows x columns x 16.

    Dijkstra's algorithm with buckets as wide as the cheapest edge (Dial 1969, Dinic 1978) in place of a queue; each
    bucket is a doubly linked list of states, `after` and `before`.
    """
    rows, columns = representatives.shape[:2]
    cost = np.full(rows * columns * 16, np.inf)
    width = min(move_costs.min(), turn_costs.min())
    count = int(max(move_costs.max(), turn_costs.max(), start_turns.max()) / width) + 2
    heads = np.full(count, -1, np.int64)
    after, before = np.full(len(cost), -1, np.int32), np.full(len(cost), -1, np.int32)
    left = 0
    if traversable[row, column]:
        cell = (row // factor) * columns + column // factor
        for h in range(16):
            cost[cell * 16 + h] = start_turns[h]
            _put(heads, after, before, cell * 16 + h, -1, int(start_turns[h] / width))
        left = 16
    level = 0
    while left > 0:
        state = heads[level % count]
        if state < 0:
            level += 1
            continue
        _put(heads, after, before, state, level % count, -1)
        left -= 1
        here, cell, h = cost[state], state // 16, state % 16
        for edge in range(3):
            if edge < 2:
                to_h = (h + 1) % 16 if edge == 0 else (h + 15) % 16
                to, through = cell * 16 + to_h, here + turn_costs[h if edge == 0 else to_h]
            else:
                to, through = state + (moves[h, 0] * columns + moves[h, 1]) * 16, here + move_costs[h]
            if to < 0 or to >= len(cost) or not through < cost[to] - 1e-9:
                continue
            r, c = cell // columns, cell % columns
            if edge == 2 and not _may_move(traversable, representatives, factor, r, c, moves[h, 0], moves[h, 1]):
                continue
            old = -1
            if np.isfinite(cost[to]):
                old = int(cost[to] / width) % count
            else:
                left += 1
            cost[to] = through
            _put(heads, after, before, to, old, int(through / width) % count)
    return cost.reshape(rows, columns, 16)
