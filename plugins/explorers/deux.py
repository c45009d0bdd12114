"""The depth-uncertainty-guided explorer: Algorithm 1 of the paper."""

from typing import Literal

import numpy as np

from deux.contracts import Action, Episode, ExplorerMap, Need, Observation
from deux.errors import DeuxError
from deux.mapping.frontier_targets import FrontierCandidates, cell_centres
from deux.mapping.goal_explorer import DepthSource, GoalExplorer
from deux.mapping.navigation import Motion
from deux.mapping.occupancy import UNKNOWN
from deux.mapping.pursuit import Target
from deux.mapping.residual_field import PoseResidualField, ResidualField, SurfaceResidualField


class DeuxExplorer(GoalExplorer):
    """Goes where the depth model's uncertainty is high.

    Each target is drawn among places on the frontiers with probability proportional to u ** (1 / temperature),
    where u is the uncertainty recorded nearby (Eq. 8); a target is kept until the robot is there or gives it up.
    Where no frontier is left, the places are drawn from the free floor instead.

    Args:
        residual_pose: where uncertainty lives: at the "pose" that the robot stood at, or on the "surface" that the
            depth model got wrong.
        map_depth: what the map is built from: the "predicted" depth (the paper) or the "sensor".
        target: "sampled", drawn as above; or "greedy", the place with the highest uncertainty.
        temperature: 1 draws in proportion to the uncertainty; towards 0 the draw becomes greedy. Uncertainties of
            one scene differ by tens of per cent only: 0.25 draws a place of twice the uncertainty 16 times as often.
        resolution: edge of a map cell in metres.
        max_range: distance along the floor in metres up to which depth enters the map.
        safety_margin: metres that paths keep from obstacles beyond the robot's radius.
        unknown_traversable: whether paths may lead through the unknown.
        motion: "arcs", turns while it goes on, where there is room; or "turns", on the spot.
    """

    spacing = 0.5
    """Metres of frontier for each place that is drawn on it."""

    places_without_frontier = 64
    """Number of places drawn from the free floor where no frontier is left."""

    def __init__(
        self,
        residual_pose: Literal["pose", "surface"] = "pose",
        map_depth: DepthSource = "predicted",
        target: Literal["sampled", "greedy"] = "sampled",
        temperature: float = 0.25,
        resolution: float = 0.05,
        max_range: float = 3.0,
        safety_margin: float = 0.05,
        unknown_traversable: bool = False,
        motion: Motion = "arcs",
    ) -> None:
        super().__init__(
            map_depth, resolution, max_range, safety_margin, unknown_traversable, "deux's map_depth", motion
        )
        if residual_pose not in ("pose", "surface"):
            raise DeuxError(f'deux\'s residual_pose is "{residual_pose}": it must be "pose" or "surface".')
        if target not in ("sampled", "greedy"):
            raise DeuxError(f'deux\'s target is "{target}": it must be "sampled" or "greedy".')
        if temperature <= 0.0:
            raise DeuxError(
                f'deux\'s temperature is {temperature}: it must be positive (target="greedy" is its limit).'
            )
        self.needs |= {Need.RESIDUAL}
        self._residual_pose = residual_pose
        self._greedy = target == "greedy"
        self._temperature = temperature

    def reset(self, episode: Episode) -> None:
        """Begin an episode."""
        super().reset(episode)
        self._field: ResidualField = (
            PoseResidualField()
            if self._residual_pose == "pose"
            else SurfaceResidualField(episode.camera, self._resolution)
        )

    def act(self, observation: Observation) -> Action:
        """Record the frame's residual, then go on towards the target."""
        assert observation.residual is not None
        assert observation.uncertainty is not None
        depth = self.map_depth(observation)
        self._field.update(observation.pose, depth, observation.residual, observation.uncertainty)
        return super().act(observation)

    def map(self) -> ExplorerMap | None:
        """The occupancy map with the uncertainty field over what is known of the floor."""
        known = super().map()
        if known is None:
            return None
        uncertainty = np.where(known.occupancy == UNKNOWN, np.float32(np.nan), self._field.grid(known.frame))
        return ExplorerMap(known.frame, known.occupancy, uncertainty)

    def choose_target(self, pose: np.ndarray, candidates: FrontierCandidates, distance: np.ndarray) -> Target | None:
        """`SampleFrontiers`, then `SampleDepthGuidedTarget`."""
        frame = self.occupancy.frame
        if len(candidates) == 0:
            places = self.free_places(distance, self.places_without_frontier)
            row, column = places[self._draw(cell_centres(frame, places))]
            return Target(frame.centre(row, column))
        per_frontier = self.spacing / frame.resolution
        sampled = np.concatenate(
            [
                self.rng.choice(members, max(1, round(len(members) / per_frontier)), replace=False)
                for members in (np.flatnonzero(candidates.frontier == f) for f in np.unique(candidates.frontier))
            ]
        )
        chosen = self._draw(cell_centres(frame, candidates.cells[sampled]))
        return self.frontier_target(candidates, int(sampled[chosen]))

    def _draw(self, points: np.ndarray) -> int:
        """Index of one of N x 2 world points, drawn by the uncertainty near them."""
        uncertainty = self._field.at(points)
        if self._greedy:
            return int(np.argmax(uncertainty))
        largest = uncertainty.max()
        if largest <= 0.0:
            return int(self.rng.integers(len(points)))
        weights = (uncertainty / largest) ** (1.0 / self._temperature)
        return int(self.rng.choice(len(points), p=weights / weights.sum()))
