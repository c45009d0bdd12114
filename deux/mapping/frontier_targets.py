"""Targets on frontiers: which frontier cells can be reached, where to stand, and which way to look."""

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
    """Frontier cells that the robot can go to and look at.

    Args:
        cells: N x 2 int64 (row, column) of the frontier cells.
        places: N x 2 int64, where to stand for each.
        lengths: N float64, the length of the path there in cells.
        frontier: N int64, which frontier each cell belongs to, 0 for the largest.
    """

    cells: np.ndarray
    places: np.ndarray
    lengths: np.ndarray
    frontier: np.ndarray

    def __len__(self) -> int:
        return len(self.cells)

    def select(self, keep: np.ndarray) -> "FrontierCandidates":
        """Those where N bool `keep` is true."""
        return FrontierCandidates(self.cells[keep], self.places[keep], self.lengths[keep], self.frontier[keep])

    def preferred(self, least_length: float, least_size: int) -> "FrontierCandidates":
        """Those that are worth walking to: far enough and on a frontier with enough cells; all where none is.

        Next to the robot, the edges of what its camera shows are always frontiers. They take the fewest actions, turns
        on the spot, and show little; many vanish when the robot goes on.

        Args:
            least_length: cells of path to the place at least.
            least_size: candidates on the same frontier at least.
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
    """All frontier cells that can be reached.

    Args:
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        frame: where the grid lies.
        distance: rows x columns path lengths from the robot in cells, inf where it cannot go.
        min_size: frontiers of fewer cells are left out.
        reach: metres from a frontier cell within which the robot may stand.
        finished: rows x columns bool, frontier cells that are left out.
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
