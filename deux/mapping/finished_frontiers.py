"""Finished frontiers: frontier cells that are not chosen as targets again, so that exploration ends."""

import math

import numpy as np

from deux.geometry.grid import GridFrame
from deux.mapping.frontier_targets import cell_centres
from deux.mapping.frontiers import frontier_mask
from deux.mapping.navigation import heading_error
from deux.mapping.occupancy import OCCUPIED
from deux.mapping.planning import line_is_clear
from deux.mapping.pursuit import Point


class FinishedFrontiers:
    """The frontier cells that remained after the robot looked at them from nearby, or that it could not reach.

    Only single cells are excluded, not the floor around them: new frontier cells beside them, behind a thin wall or
    outside the image can still be chosen. A target's own cell is always added when its pursuit ends, so that no cell is
    a target twice and the robot cannot alternate between two.

    Args:
        reach: metres around a target's frontier cell within which cells are finished together with it.
        field_of_view: the camera's, in radians.
    """

    def __init__(self, reach: float, field_of_view: float) -> None:
        self._reach = reach
        self._half_view = field_of_view / 2.0
        self._points: list[Point] = []  # world coordinates, which stay valid when the map grows

    def mask(self, frame: GridFrame) -> np.ndarray:
        """The finished cells over a map, which may have grown since, rows x columns bool."""
        mask = np.zeros(frame.shape, bool)
        if self._points:
            x, z = np.array(self._points).T
            mask[frame.cells(x, z)] = True
        return mask

    def finish(self, cells: np.ndarray, frame: GridFrame, target: Point, pose: np.ndarray | None) -> None:
        """Finish a target, and the visible frontier cells within reach of it.

        Args:
            cells: the occupancy, rows x columns int8.
            frame: position, size and resolution of the grid.
            target: the centre of the frontier cell, world (x, z).
            pose: 4 x 4, the camera-to-world matrix from which the robot looked at the target; None if it did not get
                there, which finishes the cells that are visible from the target itself in any direction.
        """
        near = self._frontier_near(cells, frame, target)
        eye = target
        if pose is not None:
            eye = pose[0, 3], pose[2, 3]
            in_view = np.abs(heading_error(pose, *cell_centres(frame, near).T)) < self._half_view
            near = near[in_view]
        open_cells, start = cells != OCCUPIED, frame.cell(*eye)
        seen = [frame.centre(row, column) for row, column in near if line_is_clear(open_cells, start, (row, column))]
        self._points += [target, *seen]

    def any_left(self, cells: np.ndarray, frame: GridFrame, target: Point) -> bool:
        """Whether the frontier within reach of a target has a cell that is not finished; arguments as in `finish`."""
        rows, columns = self._frontier_near(cells, frame, target).T
        return not self.mask(frame)[rows, columns].all()

    def _frontier_near(self, cells: np.ndarray, frame: GridFrame, target: Point) -> np.ndarray:
        """The frontier cells within reach of a point, N x 2 int64 (row, column)."""
        (row, column), margin = frame.cell(*target), math.ceil(self._reach / frame.resolution) + 2
        top, left = max(0, row - margin), max(0, column - margin)
        window = cells[top : row + margin + 1, left : column + margin + 1]
        frontier = np.argwhere(frontier_mask(window)) + np.array([top, left])
        return frontier[np.hypot(*(cell_centres(frame, frontier) - target).T) <= self._reach + 1e-6]
