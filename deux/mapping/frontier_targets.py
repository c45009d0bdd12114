"""Targets on frontiers: reachable frontier cells, where to stand for each, and where to look."""

from dataclasses import dataclass

import numpy as np

from deux.geometry.grid import GridFrame
from deux.mapping.frontiers import find_frontiers
from deux.mapping.occupancy import OCCUPIED
from deux.mapping.pursuit import Target
from deux.mapping.traversable import approaches, unknown_beside


def cell_centres(frame: GridFrame, cells: np.ndarray) -> np.ndarray:
    """World (x, z) of the centres of N x 2 cells (row, column), N x 2 float64."""
    origin = np.array([frame.origin_x, frame.origin_z])
    return origin + (cells[:, ::-1] + 0.5) * frame.resolution


@dataclass(frozen=True)
class FrontierCandidates:
    """Frontier cells that the robot can look at from a reachable place.

    Args:
        cells: N x 2 int64 (row, column) of the frontier cells.
        places: N x 2 int64, where to stand for each.
        lengths: N float64, the path length to that place in cells.
        frontier: N int64, the frontier of each cell, 0 for the largest.
    """

    cells: np.ndarray
    places: np.ndarray
    lengths: np.ndarray
    frontier: np.ndarray

    def __len__(self) -> int:
        return len(self.cells)

    def select(self, keep: np.ndarray) -> "FrontierCandidates":
        """The candidates selected by a mask or by indices."""
        return FrontierCandidates(self.cells[keep], self.places[keep], self.lengths[keep], self.frontier[keep])

    def preferred(self, least_length: float, least_size: int) -> "FrontierCandidates":
        """The candidates that are far enough away on a large enough frontier; all if there is none.

        The edges of the camera's view next to the robot are always frontiers. They cost the fewest actions, turns on
        the spot, but reveal little, and many disappear when the robot moves on.

        Args:
            least_length: least path length to the place, in cells.
            least_size: least number of candidates on the same frontier.
        """
        size = np.bincount(self.frontier)[self.frontier]
        keep = (self.lengths >= least_length) & (size >= least_size)
        return self.select(keep) if keep.any() else self


def frontier_candidates(
    occupancy: np.ndarray,
    frame: GridFrame,
    distance: np.ndarray,
    min_size: int,
    reach: float,
    finished: np.ndarray | None = None,
) -> FrontierCandidates:
    """All frontier cells that can be looked at from a reachable place.

    Args:
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        frame: position, size and resolution of the grid.
        distance: rows x columns path lengths from the robot in cells, inf if unreachable.
        min_size: frontiers of fewer cells are ignored.
        reach: metres from a frontier cell within which the robot may stand.
        finished: rows x columns bool, frontier cells to ignore.
    """
    clusters = find_frontiers(occupancy, min_size, finished)
    cells = np.concatenate([np.zeros((0, 2), np.int64), *clusters])
    frontier = np.repeat(np.arange(len(clusters)), [len(cluster) for cluster in clusters])
    places, lengths = approaches(occupancy != OCCUPIED, distance, cells, round(reach / frame.resolution))
    return FrontierCandidates(cells, places, lengths, frontier).select(np.isfinite(lengths))


def frontier_target(
    occupancy: np.ndarray, frame: GridFrame, cell: np.ndarray, place: np.ndarray, reach: float
) -> Target:
    """The target that brings the robot to `place`, facing the unknown beside frontier cell `cell`."""
    unknown = unknown_beside(occupancy, int(cell[0]), int(cell[1]), round(reach / frame.resolution))
    return Target(
        place=frame.centre(float(place[0]), float(place[1])),
        look_at=None if unknown is None else frame.centre(*unknown),
    )
