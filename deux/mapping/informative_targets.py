"""Targets chosen by the expected information for the depth model per action."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from deux.contracts import Episode
from deux.geometry.grid import GridFrame
from deux.geometry.poses import yaw_of
from deux.geometry.source_frames import SOURCES, SourceRule
from deux.mapping.action_costs import action_costs
from deux.mapping.field_paths import points_on_paths
from deux.mapping.frontier_targets import cell_centres
from deux.mapping.path_views import values_along_paths
from deux.mapping.pursuit import Target
from deux.mapping.residual_field import PoseResidualField
from deux.mapping.surface_views import SurfaceViews
from deux.mapping.view_fan import RAYS, cast_rays, headings, pixel_shares

_SEEN_RAYS = 720
"""Rays of a full circle by which a frame's view is recorded; at 5 m, they are less than half a cell of 0.1 m apart."""

ResidualPlace = Literal["surface", "pose", "constant"]

HEADINGS = 12
"""Number of candidate headings at each place, one every 30 degrees."""


@dataclass(frozen=True)
class MapNow:
    """The robot's map and pose when a target is chosen.

    Args:
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        frame: position, size and resolution of the grid.
        distance: rows x columns float64, path length from the robot in cells, inf if unreachable.
        pose: 4 x 4, the camera's camera-to-world matrix.
        frontier_places: N x 2 int64 (row, column), places from which the robot can look at frontiers.
    """

    occupancy: np.ndarray
    frame: GridFrame
    distance: np.ndarray
    pose: np.ndarray
    frontier_places: np.ndarray


class InformativeTargets:
    """Chooses the target whose views, there and on the path to it, are most informative per action.

    A candidate is a place with a heading, on known free floor or at a frontier. The value of a view is the sum over the
    rays in its field of view of

        share of the image x (uncertainty of the ray's end point) ** guidance x its novelty,

    with the uncertainty from `deux.mapping.surface_views` and the novelty from `deux.mapping.path_views`. The values of
    the views along the path are added to that of the target, each as if the views before it had been taken, and the sum
    is divided by the number of actions, turns included, plus `overhead`. Values are only compared, so that the unit of
    the uncertainty does not matter.

    Args:
        episode: provides camera and robot.
        rng: source of randomness for the places.
        residual_pose: what uncertainty is assigned to: the "surface" that a ray hits; the "pose" of the camera (the
            mean over frames nearby); or "constant", so that only novelty matters.
        guidance: exponent of the uncertainty; with 0, too, only novelty matters.
        per_action: whether the value is divided by the actions.
        revisits: whether known floor is a candidate even if there are frontiers.
        on_the_way: whether the views along the path are included.
    """

    max_range = 5.0
    """Range of a view in metres."""

    spacing = 0.5
    """Metres between candidate places, and between views along a path."""

    most_places = 300
    """Maximal number of places that are compared."""

    least_way = 0.5
    """Least path length to a target in metres, if any is that far: a turn on the spot gives no parallax."""

    overhead = 3.0
    """Actions added to the cost of each target; without them, the nearest view would nearly always win."""

    switch = 1.5
    """A target is abandoned for another with at least this many times its value per action."""

    def __init__(
        self,
        episode: Episode,
        rng: np.random.Generator,
        residual_pose: ResidualPlace = "surface",
        guidance: float = 1.0,
        per_action: bool = True,
        revisits: bool = True,
        on_the_way: bool = True,
    ) -> None:
        self._camera, self._robot, self._rng = episode.camera, episode.robot, rng
        self._residual_pose, self._guidance = residual_pose, guidance
        self._per_action, self._revisits, self._on_the_way = per_action, revisits, on_the_way
        self._surfaces = SurfaceViews(episode.camera, self.max_range)
        self._poses = PoseResidualField()
        self._yaws = headings()[:: RAYS // HEADINGS]
        self._shares = pixel_shares(episode.camera, self._yaws)
        self._parallax = SourceRule()
        self._before: deque[np.ndarray] = deque(maxlen=SOURCES)

    def record(self, pose: np.ndarray, depth: np.ndarray, residual: np.ndarray, uncertainty: float) -> None:
        """Add one frame's uncertainty; see `ResidualField.update`."""
        if self._residual_pose == "surface":
            self._surfaces.record(pose, depth, residual)
        elif self._residual_pose == "pose":
            self._poses.update(pose, depth, residual, uncertainty)

    def mark_seen(self, pose: np.ndarray, occupancy: np.ndarray, frame: GridFrame) -> None:
        """Record the view of the frame at this pose, unless it has no parallax to the two frames before it.

        Args:
            pose: 4 x 4 camera-to-world.
            occupancy: rows x columns int8, which includes this frame.
            frame: position, size and resolution of the grid.
        """
        before = list(self._before)
        self._before.append(pose)
        if before and not any(self._parallax.apart(pose, earlier) for earlier in before):
            return
        rays = cast_rays(occupancy, frame, pose[[0, 2], 3][None], self.max_range, _SEEN_RAYS)
        self._surfaces.mark_seen(rays, pixel_shares(self._camera, np.array([yaw_of(pose)]), _SEEN_RAYS) > 0.0)

    def choose(self, now: MapNow) -> Target | None:
        """The target with the highest value per action; None without any candidate."""
        cells, candidate = self._places(now)
        if not candidate.any():
            return None
        rates = np.where(candidate[:, None], self._rates(now, cells), -1.0)
        place, heading = np.unravel_index(int(np.argmax(rates)), rates.shape)
        x, z = now.frame.centre(float(cells[place, 0]), float(cells[place, 1]))
        yaw = float(self._yaws[heading])
        return Target((x, z), look_at=(x - math.sin(yaw), z - math.cos(yaw)))

    def is_outdone(self, target: Target, now: MapNow) -> bool:
        """Whether another target is better than the current one by the factor `switch`; false if it is unreachable."""
        assert target.look_at is not None
        cell = now.frame.cell(*target.place)
        if not np.isfinite(now.distance[cell]):
            return False
        cells, candidate = self._places(now)
        rates = self._rates(now, np.concatenate([[cell], cells]))
        yaw = math.atan2(target.place[0] - target.look_at[0], target.place[1] - target.look_at[1])
        heading = int(np.argmax(np.cos(self._yaws - yaw)))
        return bool(rates[1:][candidate].max(initial=0.0) > self.switch * rates[0, heading])

    def values(self, now: MapNow, cells: np.ndarray, on_the_way: bool) -> np.ndarray:
        """The values of the views from N x 2 cells (row, column), N x HEADINGS float64.

        With `on_the_way`, those of the views along the path to each cell are added, each approximated by the view from
        the nearest of the cells.
        """
        places = cell_centres(now.frame, cells)
        rays = cast_rays(now.occupancy, now.frame, places, self.max_range)
        worth = np.ones(rays.kind.shape)
        if self._residual_pose == "surface":
            worth = self._surfaces.uncertainty(rays) ** self._guidance
        elif self._residual_pose == "pose":
            worth *= self._poses.at(places)[:, None] ** self._guidance
        points = points_on_paths(now.distance, cells if on_the_way else cells[:0], self.spacing / now.frame.resolution)
        nearest = cKDTree(cells).query(points.cells)[1]
        yaw = np.arctan2(-points.motion[:, 1], -points.motion[:, 0])
        heading = np.rint(yaw / (2.0 * math.pi / HEADINGS)).astype(np.int64) % HEADINGS
        return values_along_paths(self._surfaces, rays, worth, self._shares, points.goal, nearest, heading)

    def _rates(self, now: MapNow, cells: np.ndarray) -> np.ndarray:
        """The value of each target per action, N x HEADINGS."""
        worth = self.values(now, cells, self._on_the_way)
        if not self._per_action:
            return worth
        costs = action_costs(np.isfinite(now.distance), now.frame, now.pose, self._robot)
        actions = costs.to_views(np.repeat(cells, HEADINGS, axis=0), np.tile(self._yaws, len(cells)))
        return worth / (actions.reshape(worth.shape) + self.overhead)

    def _places(self, now: MapNow) -> tuple[np.ndarray, np.ndarray]:
        """N x 2 places (row, column), one in each square of floor and frontier, and N bool: which are candidates."""
        side = self.spacing / now.frame.resolution
        frontier = _one_of_each_square(now.frontier_places, side, self._rng)
        floor = _one_of_each_square(np.argwhere(np.isfinite(now.distance)), side, self._rng)
        room = max(0, self.most_places - len(frontier))
        floor = floor if len(floor) <= room else self._rng.choice(floor, room, replace=False)
        cells = np.concatenate([frontier, floor])
        candidate = (np.arange(len(cells)) < len(frontier)) | self._revisits | (len(frontier) == 0)
        far = now.distance[cells[:, 0], cells[:, 1]] * now.frame.resolution >= self.least_way
        return cells, candidate & far if (candidate & far).any() else candidate


def _one_of_each_square(cells: np.ndarray, side: float, rng: np.random.Generator) -> np.ndarray:
    """One of the N x 2 cells, drawn at random, in each square with this side."""
    drawn = rng.permutation(cells)
    rows, columns = np.floor(drawn / side).astype(np.int64).T
    _, first = np.unique(rows * (columns.max(initial=0) + 1) + columns, return_index=True)
    return drawn[first]
