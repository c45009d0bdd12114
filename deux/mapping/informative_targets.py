"""Targets by what a view from there is expected to teach the depth model, for each action that it costs."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from deux.contracts import Episode
from deux.geometry.grid import GridFrame
from deux.geometry.poses import yaw_of
from deux.mapping.action_costs import action_costs
from deux.mapping.frontier_targets import cell_centres
from deux.mapping.pursuit import Target
from deux.mapping.residual_field import PoseResidualField
from deux.mapping.surface_views import SurfaceViews
from deux.mapping.view_fan import RAYS, cast_rays, headings, pixel_shares

UncertaintyOf = Literal["surface", "pose", "constant"]

HEADINGS = 12
"""Headings in which the robot may look at each place: one every 30 degrees."""


@dataclass(frozen=True)
class MapNow:
    """The robot's map at the moment of a choice.

    Args:
        occupancy: rows x columns int8: 0 unknown, 1 occupied, 2 free.
        frame: where the grid lies.
        distance: rows x columns float64, path length from the robot in cells, inf where it cannot go.
        pose: 4 x 4, the camera's camera-to-world matrix.
    """

    occupancy: np.ndarray
    frame: GridFrame
    distance: np.ndarray
    pose: np.ndarray


class InformativeTargets:
    """Chooses the view with the greatest value for each action.

    A candidate is a place with a heading. Its value is the sum over the rays of its field of view of

        share of the image x uncertainty of what the ray shows x what is left to learn from it,

    see `deux.mapping.surface_views`; the value is divided by the actions that lead there and `overhead`. Places are
    frontier places and known free floor alike. The values are only compared with each other: any unit will do.

    Args:
        episode: its camera and robot.
        rng: draws the places.
        uncertainty: what uncertainty belongs to: the "surface" that a ray shows, the "pose" from which it is seen
            (the residuals of frames nearby), or "constant", the same everywhere, so that only novelty counts.
        per_action: whether the value is divided by the actions.
        revisits: whether known floor is a candidate as long as there is a frontier to go to.
    """

    max_range: float = 5.0
    """Metres that a view reaches."""

    spacing: float = 0.5
    """Metres between the places on known floor, and between those on a frontier."""

    most_places: int = 250
    """Places that are looked at for one choice."""

    least_way: float = 0.5
    """Metres that a target is away at least, if any is: a turn on the spot gives no parallax."""

    overhead: float = 10.0
    """Actions that are added to each way; without them the nearest view always wins."""

    switch: float = 1.5
    """The target is given up for another whose rate is greater by this factor."""

    def __init__(
        self,
        episode: Episode,
        rng: np.random.Generator,
        uncertainty: UncertaintyOf = "surface",
        per_action: bool = True,
        revisits: bool = True,
    ) -> None:
        self._camera, self._robot, self._rng = episode.camera, episode.robot, rng
        self._uncertainty = uncertainty
        self._per_action = per_action
        self._revisits = revisits
        self._surfaces = SurfaceViews(episode.camera, self.max_range)
        self._poses = PoseResidualField()
        self._yaws = headings()[:: RAYS // HEADINGS]
        self._shares = pixel_shares(episode.camera, self._yaws)
        self._last_place: np.ndarray | None = None

    def record(self, pose: np.ndarray, depth: np.ndarray, residual: np.ndarray, uncertainty: float) -> None:
        """Add one frame's uncertainty; arguments as of `ResidualField.update`."""
        if self._uncertainty == "surface":
            self._surfaces.record(pose, depth, residual)
        elif self._uncertainty == "pose":
            self._poses.update(pose, depth, residual, uncertainty)

    def mark_seen(self, pose: np.ndarray, occupancy: np.ndarray, frame: GridFrame) -> None:
        """Remember what the frame at this pose showed, unless the robot only turned since the frame before it.

        Args:
            pose: 4 x 4 camera-to-world.
            occupancy: rows x columns int8, with this frame in it.
            frame: where the grid lies.
        """
        place = pose[[0, 2], 3]
        moved = self._last_place is None or np.hypot(*(place - self._last_place)) >= 0.4 * self._robot.forward_step
        self._last_place = place
        if moved:
            rays = cast_rays(occupancy, frame, place[None], self.max_range)
            self._surfaces.mark_seen(rays, pixel_shares(self._camera, np.array([yaw_of(pose)])) > 0.0)

    def choose(self, now: MapNow, frontier_places: np.ndarray) -> Target | None:
        """The view with the greatest rate; None where there is no place to go to.

        Args:
            now: the map.
            frontier_places: N x 2 (row, column) from which frontiers can be seen.
        """
        cells = self._places(now, frontier_places)
        if len(cells) == 0:
            return None
        rates = self._rates(now, cells)
        place, heading = np.unravel_index(int(np.argmax(rates)), rates.shape)
        return _view(now.frame.centre(*cells[place].astype(float)), float(self._yaws[heading]))

    def is_outdone(self, target: Target, now: MapNow, frontier_places: np.ndarray) -> bool:
        """Whether another view's rate is greater by the factor `switch`; arguments as of `choose`."""
        assert target.look_at is not None
        cells = self._places(now, frontier_places)
        row, column = now.frame.cell(*target.place)
        if len(cells) == 0 or not np.isfinite(now.distance[row, column]):
            return False
        own = self._rates(now, np.array([[row, column]]))[0]
        yaw = math.atan2(target.place[0] - target.look_at[0], target.place[1] - target.look_at[1])
        heading = int(np.argmax(np.cos(self._yaws - yaw)))
        return bool(self._rates(now, cells).max() > self.switch * own[heading])

    def _rates(self, now: MapNow, cells: np.ndarray) -> np.ndarray:
        """What each view is worth for an action, N x HEADINGS."""
        values = self.values(now, cells)
        if not self._per_action:
            return values
        costs = action_costs(np.isfinite(now.distance), now.frame, now.pose, self._robot)
        actions = costs.to_views(np.repeat(cells, HEADINGS, axis=0), np.tile(self._yaws, len(cells)))
        return values / (actions.reshape(values.shape) + self.overhead)

    def values(self, now: MapNow, cells: np.ndarray) -> np.ndarray:
        """What the views from N x 2 cells (row, column) are expected to teach, N x HEADINGS float64."""
        points = cell_centres(now.frame, cells)
        rays = cast_rays(now.occupancy, now.frame, points, self.max_range)
        worth = self._surfaces.novelty(rays) * (rays.kind > 0)
        if self._uncertainty == "surface":
            worth *= self._surfaces.uncertainty(rays)
        elif self._uncertainty == "pose":
            worth *= self._poses.at(points)[:, None]
        return worth @ self._shares.T

    def _places(self, now: MapNow, frontier_places: np.ndarray) -> np.ndarray:
        """Candidate places, N x 2 (row, column): one on each square of the floor, and the same of the frontiers."""
        places = [_thinned(frontier_places, self.spacing / now.frame.resolution, self._rng)]
        if self._revisits or len(frontier_places) == 0:
            places.append(_thinned(np.argwhere(np.isfinite(now.distance)), self.spacing / now.frame.resolution, self._rng))
        cells = np.concatenate(places)
        far = now.distance[cells[:, 0], cells[:, 1]] * now.frame.resolution >= self.least_way
        cells = cells[far] if far.any() else cells
        if len(cells) > self.most_places:
            cells = self._rng.choice(cells, self.most_places, replace=False)
        return cells


def _thinned(cells: np.ndarray, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """One of the N x 2 cells, drawn at random, in each square of `spacing` cells."""
    drawn = rng.permutation(cells)
    _, first = np.unique(np.floor(drawn / spacing).astype(np.int64), axis=0, return_index=True)
    return drawn[first]


def _view(place: tuple[float, float], yaw: float) -> Target:
    """The target that stands at a world point (x, z) and looks along a heading."""
    return Target(place, look_at=(place[0] - math.sin(yaw), place[1] - math.cos(yaw)))
