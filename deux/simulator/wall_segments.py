"""The walls around the free floor as straight segments, along which the robot slides instead of staircases of cells.

As in Recast, the border of the free cells is traced and simplified. Unlike in Recast, it is simplified towards the
floor: the segments do not enclose positions outside of the free cells, and keep connected free cells connected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import cv2
import numpy as np
from skimage.measure import find_contours

from deux.compilation import compiled

TOLERANCE = 0.9  # cells; less than 1, the deviation of a single recessed cell
LARGEST_DEVIATION = 0.7  # cells from a line to the borders of cells along it; at a straight wall these deviate by 0.5
SHORTEST = 3.0  # cells; the shortest line that is fitted to a contour
FARTHEST_CORNER = 1.0  # cells from the contour's corners to the intersection of two lines
INSET = 1e-4  # cells from the segments to the border of the free cells, as a margin for rounding errors


def wall_segments(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Approximate the borders of the free cells of a grid by closed loops of straight segments.

    A stretch of a contour that deviates by at most `TOLERANCE` from a chord becomes a line, fitted by least squares
    and then moved towards the floor until the contour is behind it. If a line would leave the free cells or cross
    another one, for example in passages one cell wide, the contour is kept, except that convex corners of the floor are
    bevelled: a robot that slides along a staircase of cells then meets slopes and is not stopped by risers.

    Args:
        free: rows x columns bool.

    Returns:
        Starts and ends, S x 2 float64 each, as (x, y) in cells: cell (row, column) covers column <= x < column + 1,
        row <= y < row + 1. The floor is on the side of (-uy, ux), where (ux, uy) is the direction of a segment.
    """
    padded = np.pad(free, 1)
    # Cells that touch only at a corner are not connected.
    traced = find_contours(padded.astype(np.float64), 0.5, fully_connected="low")
    contours = [_Contour(loop[:-1, ::-1] - 0.5) for loop in traced]
    loops = [contour.segments() for contour in contours]
    while True:
        starts, ends, owners = (np.concatenate(parts) for parts in zip(_NO_SEGMENTS, *loops, strict=True))
        of_contour = np.repeat(np.arange(len(loops)), [len(loop[2]) for loop in loops])
        wrong = (owners >= 0) & (_leaves(padded, starts + 1.0, ends + 1.0) | _crosses(starts, ends))
        if not wrong.any():
            return starts, ends
        for number in np.unique(of_contour[wrong]):
            contours[number].simplify_less(np.unique(owners[wrong & (of_contour == number)]))
            loops[number] = contours[number].segments()


_NO_SEGMENTS = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int64)


class _Form(IntEnum):
    """How a line ends, in the order in which forms are tried from the highest value down."""

    WHOLE = 0
    SHORTENED = 1  # by one cell at both ends, so that a robot sliding from the contour to the line meets no riser
    TO_CORNER = 2  # at the intersection with the next line, if there is one


@dataclass
class _Piece:
    """A stretch of a contour that becomes a line.

    Args:
        borders: consecutive indices of the cell borders that it replaces.
        start: 2, the line's first point.
        end: 2, its last point.
        form: how it ends.
    """

    borders: np.ndarray
    start: np.ndarray
    end: np.ndarray
    form: _Form = _Form.TO_CORNER

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """The first and last point, shortened unless the form is `WHOLE`."""
        if self.form == _Form.WHOLE:
            return self.start, self.end
        cell = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        return self.start + cell, self.end - cell


class _Contour:
    """One closed contour of the free cells.

    Args:
        middles: M x 2, the midpoints of its M cell borders; the free cells are on the side of (-uy, ux).
    """

    def __init__(self, middles: np.ndarray) -> None:
        self._middles = middles
        following = np.roll(middles, -1, axis=0)
        # Each of two borders that meet at a corner determines the coordinate in which it is on a grid line.
        gridded, following_gridded = middles % 1.0 == 0.0, following % 1.0 == 0.0
        either = np.where(gridded, middles, following)
        corners = np.where(gridded == following_gridded, (middles + following) / 2.0, either)
        self._direction = corners - np.roll(corners, 1, axis=0)
        self._normal = np.stack([-self._direction[:, 1], self._direction[:, 0]], axis=1)
        ahead, ahead_normal = np.roll(self._direction, -1, axis=0), np.roll(self._normal, -1, axis=0)
        self._turn = self._direction[:, 0] * ahead[:, 1] - self._direction[:, 1] * ahead[:, 0]
        straight = (self._turn == 0.0)[:, None]
        self._corners = corners + INSET * np.where(straight, self._normal, self._normal + ahead_normal)
        self._positions, self._points = self._halve_corner_cells(corners)
        self.pieces = self._find_pieces()

    def segments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Starts and ends, S x 2, and the piece to simplify less if the segment is invalid, S, -1 for none."""
        on_contour = np.ones(len(self._positions), dtype=bool)
        ends: list[tuple[float, np.ndarray, int]] = []  # of lines: position along the contour, point, piece
        corners = [self._corner(number) for number in range(len(self.pieces))]
        for number, piece in enumerate(self.pieces):
            first, last = self._span(piece)
            on_contour &= ~_between(self._positions, first, last)
            start, end = piece.ends
            if corners[number - 1] is None:
                ends.append((first, start, number))
            corner = corners[number]
            if corner is not None:
                end = corner
                after, _ = self._span(self.pieces[(number + 1) % len(self.pieces)])
                on_contour &= ~_between(self._positions, last, after)
            ends.append((last, end, number))
        order = np.argsort([*self._positions[on_contour], *(position for position, _, _ in ends)], kind="stable")
        points = np.array([*self._points[on_contour], *(point for _, point, _ in ends)])[order]
        pieces = np.array([-1] * int(on_contour.sum()) + [number for _, _, number in ends])[order]
        apart = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1) > INSET / 10.0
        points, pieces = points[apart], pieces[apart]
        # A segment from the contour to a line is assigned to the line.
        return points, np.roll(points, -1, axis=0), np.where(pieces >= 0, pieces, np.roll(pieces, -1))

    def _span(self, piece: _Piece) -> tuple[float, float]:
        """The positions along the contour at which a piece begins and ends."""
        # Corner i is at position i, the midpoint of border i half a border before it.
        first, last = (piece.borders[[0, -1]] - 0.5) % len(self._middles)
        return first, last

    def simplify_less(self, wrong: np.ndarray) -> None:
        """Change pieces, given by their indices, to their next form; pieces in the last form are halved."""
        pieces = []
        for number, piece in enumerate(self.pieces):
            if number in wrong and piece.form == _Form.WHOLE:
                pieces += self._fit(np.array_split(piece.borders, 2))
            elif number in wrong:
                pieces.append(replace(piece, form=_Form(piece.form - 1)))
            else:
                pieces.append(piece)
        self.pieces = pieces

    def _halve_corner_cells(self, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The contour with bevelled convex corners: N positions along it, and N x 2 points."""
        count = len(corners)
        number = np.arange(count, dtype=np.float64)
        inner, outer = self._turn > 0.0, self._turn < 0.0  # convex corners of the floor, and of obstacles
        positions, points = [number[outer]], [self._corners[outer]]
        for side in (-1, 1):
            beyond = np.roll(np.arange(count), -side)
            reach = np.where(inner[beyond], 0.5, 1.0)
            bevelled = inner & ~outer[beyond]
            border = np.arange(count) if side < 0 else beyond
            place = corners + side * reach[:, None] * self._direction[border] + INSET * self._normal[border]
            positions.append((number + side * reach)[bevelled] % count)
            points.append(place[bevelled])
        return np.concatenate(positions), np.concatenate(points)

    def _find_pieces(self) -> list[_Piece]:
        """The stretches between the points of the Douglas-Peucker simplification, merged if one line fits both."""
        approximated = cv2.approxPolyDP(self._middles.astype(np.float32), TOLERANCE, True)[:, 0]
        index = {(x, y): number for number, (x, y) in enumerate(self._middles.tolist())}
        breaks = sorted(index[x, y] for x, y in approximated.tolist())
        for here in breaks[:]:
            place = breaks.index(here)
            before, after = breaks[place - 1], breaks[(place + 1) % len(breaks)]
            if len(breaks) > 3 and self._deviation(self._inside(before, after)) <= LARGEST_DEVIATION:
                breaks.remove(here)
        stretches = [self._inside(first, last) for first, last in zip(breaks, [*breaks[1:], breaks[0]], strict=True)]
        return self._fit(stretches)

    def _inside(self, first: int, last: int) -> np.ndarray:
        """The borders between two breaks, without those at the breaks, which belong to both walls."""
        count = len(self._middles)
        return np.arange(first + 1, last if last > first else last + count) % count

    def _deviation(self, borders: np.ndarray) -> float:
        """The largest distance of borders from their line."""
        mean, direction = _line(self._middles[borders])
        return float(np.abs((self._middles[borders] - mean) @ [-direction[1], direction[0]]).max())

    def _fit(self, stretches: list[np.ndarray]) -> list[_Piece]:
        """Fit lines to stretches of borders, with all corners of the stretch behind them; short stretches get none."""
        pieces = []
        for borders in stretches:
            middles = self._middles[borders]
            if len(borders) < 2 or np.linalg.norm(middles[-1] - middles[0]) < SHORTEST:
                continue
            mean, direction = _line(middles)
            normal = np.array([-direction[1], direction[0]])
            mean = mean + ((self._corners[borders[:-1]] - mean) @ normal).max() * normal
            start, end = (mean + (middle - mean) @ direction * direction for middle in middles[[0, -1]])
            pieces.append(_Piece(borders, start, end))
        return pieces

    def _corner(self, number: int) -> np.ndarray | None:
        """The intersection of a piece's line with that of the next piece; None if they should not meet."""
        piece, after = self.pieces[number], self.pieces[(number + 1) % len(self.pieces)]
        if piece.form != _Form.TO_CORNER or len(self.pieces) < 2:
            return None
        along, along_after = piece.end - piece.start, after.end - after.start
        across = along[0] * along_after[1] - along[1] * along_after[0]
        if abs(across) < 1e-9:
            return None
        gap = after.start - piece.start
        corner = piece.start + along * (gap[0] * along_after[1] - gap[1] * along_after[0]) / across
        between = self._corners[self._inside(piece.borders[-1] - 1, after.borders[0])]
        far = np.linalg.norm(between - corner, axis=1).min() > FARTHEST_CORNER
        turned_back = ((corner - piece.start) @ along) < 0.5 * along @ along
        turned_back |= ((after.end - corner) @ along_after) < 0.5 * along_after @ along_after
        return None if far or turned_back else corner


def _line(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and direction of the least-squares line of N x 2 points, directed from the first point to the last."""
    mean = points.mean(axis=0)
    direction = np.linalg.svd(points - mean, full_matrices=False)[2][0]
    return mean, direction * np.copysign(1.0, direction @ (points[-1] - points[0]))


def _between(positions: np.ndarray, first: float, last: float) -> np.ndarray:
    """Which positions along a closed contour are between `first` and `last`."""
    after, before = positions >= first, positions <= last
    return after & before if first <= last else after | before


@compiled(nogil=True)
def _leaves(free: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Which of S segments, in cells and inside the grid, pass through cells that are not free."""
    leaves = np.zeros(len(starts), np.bool_)
    for i in range(len(starts)):
        leaves[i] = not is_clear(free, starts[i, 0], starts[i, 1], ends[i, 0], ends[i, 1])
    return leaves


@compiled(nogil=True)
def is_clear(free: np.ndarray, x: float, y: float, end_x: float, end_y: float) -> bool:
    """Whether all cells on the line between two points, in cells and inside the grid, are free."""
    column, row = int(np.floor(x)), int(np.floor(y))
    end_column, end_row = int(np.floor(end_x)), int(np.floor(end_y))
    dx, dy = end_x - x, end_y - y
    while free[row, column]:
        if column == end_column and row == end_row:
            return True
        # The fractions of the line at which it leaves the column and the row.
        to_column = ((column + (dx > 0.0)) - x) / dx if column != end_column else np.inf
        to_row = ((row + (dy > 0.0)) - y) / dy if row != end_row else np.inf
        if to_column < to_row:
            column += 1 if dx > 0.0 else -1
        else:
            row += 1 if dy > 0.0 else -1
    return False


def _crosses(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Which of S segments cross another one; segments with a common end do not cross."""
    order = np.argsort(np.minimum(starts[:, 0], ends[:, 0]))
    crosses = np.zeros(len(starts), dtype=bool)
    crosses[order] = _crosses_sorted(starts[order], ends[order])
    return crosses


@compiled(nogil=True)
def _crosses_sorted(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """`_crosses` for segments sorted by their smaller x."""
    crosses = np.zeros(len(starts), np.bool_)
    for i in range(len(starts)):
        ax, ay, bx, by = starts[i, 0], starts[i, 1], ends[i, 0], ends[i, 1]
        for j in range(i + 1, len(starts)):
            cx, cy, dx, dy = starts[j, 0], starts[j, 1], ends[j, 0], ends[j, 1]
            if min(cx, dx) > max(ax, bx):
                break
            if min(cy, dy) > max(ay, by) or max(cy, dy) < min(ay, by):
                continue
            if (
                _side(ax, ay, bx, by, cx, cy) * _side(ax, ay, bx, by, dx, dy) < 0.0
                and _side(cx, cy, dx, dy, ax, ay) * _side(cx, cy, dx, dy, bx, by) < 0.0
            ):
                crosses[i] = crosses[j] = True
    return crosses


@compiled(nogil=True)
def _side(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Positive if (x, y) is on the floor's side of the line from (ax, ay) to (bx, by)."""
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)
