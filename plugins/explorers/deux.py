"""The explorer guided by depth uncertainty: Algorithm 1 of the paper, with extensions."""

import logging
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from deux.contracts import Episode, ExplorerMap, Need, Observation
from deux.errors import DeuxError, check_range
from deux.log_once import warn_once
from deux.mapping.frontier_targets import FrontierCandidates, cell_centres
from deux.mapping.goal_explorer import DepthSource, GoalExplorer
from deux.mapping.informative_targets import InformativeTargets, MapNow, ResidualPlace
from deux.mapping.navigation import Motion
from deux.mapping.occupancy import UNKNOWN
from deux.mapping.pursuit import Target
from deux.mapping.residual_field import PoseResidualField, ResidualField, SurfaceResidualField
from deux.options import options

log = logging.getLogger(__name__)

OF_FRONTIERS = ("temperature", "guidance", "least_way", "keep_targets")
"""Options that only sampled and greedy targets have; the temperature is of sampled ones alone."""

OF_VIEWS = ("view_guidance", "revisits", "on_the_way")
"""Options that only informative targets have."""


class DeuxExplorer(GoalExplorer):
    """Drives to views that are expected to teach the depth model most, by its uncertainty.

    Each target is the view, on known floor or at a frontier, with the highest expected information per action: the
    uncertainty of the surfaces that it would show, less where they have been seen before
    (`deux.mapping.informative_targets`).

    With target="sampled", as in the paper, each target is sampled from places on the frontiers with probability
    proportional to w ** (1 / temperature), where w = u ** guidance / (actions to get there + `overhead`) and u is the
    uncertainty nearby (Eq. 8). A frontier that is resolved on the way, by coming into view, is abandoned. If no
    frontier is left, places on the free floor are sampled in proportion to u ** (1 / temperature).

    The paper's explorer is `explore=deux_paper`, this class with other options (conf/explore/deux_paper.yaml).

    Args:
        residual_pose: what uncertainty is assigned to: the "surface" whose depth was wrong; the robot's "pose" (as in
            the paper), from which most frontiers are too far away to differ; or "constant", the same everywhere.
        map_depth: the depth that the map is built from: "predicted" (as in the paper) or of the "sensor".
        target: "informative" or "sampled", as above; or "greedy", the place on a frontier with the largest w.
        temperature: of sampled targets: with 1, probabilities are proportional to w; near 0, sampling becomes greedy.
        guidance: exponent of the uncertainty, for sampled and greedy targets: with 2, a place with twice the
            uncertainty may cost four times the actions. With 0, only the actions matter.
        view_guidance: exponent of the uncertainty, for informative targets: with 1, views of surfaces with twice the
            uncertainty are worth twice as much; with 0, only the novelty of what they show matters.
        resolution: edge of a map cell in metres.
        max_range: distance along the floor in metres up to which depth is mapped.
        depth_error: relative depth error that the map allows for: if it is too small, errors turn floor into obstacles;
            if it is too large, low obstacles become floor. None is 0 for the sensor's depth; for predicted depth it is
            the error measured at the frames' sparse points (`Observation.depth_error`).
        max_incidence: degrees between the line of sight and a surface's normal above which pixels of predicted depth
            are not mapped. 81 excludes the ramps by which networks blur steps in depth but, in images of 64 x 64
            pixels, also some small obstacles. 90 excludes nothing. No effect on the sensor's depth.
        visited_is_free: whether floor that the robot has been on stays free on a map of predicted depth, and its way
            back open, whatever later frames show.
        safety_margin: distance in metres that paths keep from obstacles, besides the robot's radius.
        unknown_traversable: whether paths may lead through unknown cells.
        motion: "arcs" for turning while moving, if there is room; or "turns" for turning on the spot.
        least_way: least path length in metres to the frontier of a sampled or greedy target, if there is a large enough
            frontier that far away. Nearer ones are mostly edges of the view beside the robot, for which it would turn
            on the spot. 0 for no limit.
        per_action: whether the value of a target is divided by the actions that it costs; Eq. 8 of the paper does not
            divide.
        keep_targets: whether a sampled or greedy frontier remains the target after it has come into view, as in the
            paper.
        revisits: whether informative targets can be on known floor even if there are frontiers.
        on_the_way: whether the value of an informative target includes the views on the path to it.
    """

    spacing = 0.5
    """Metres of frontier for each place that is sampled on it."""

    places_without_frontier = 64
    """Number of places sampled from the free floor if no frontier is left."""

    overhead = InformativeTargets.overhead
    """Actions added to the cost of each frontier; without them, the nearest one would nearly always win."""

    clearly = 1.5
    """A frontier nearer than `least_way` is allowed if it is this many times as uncertain as all farther ones."""

    review_interval = 8
    """Number of actions after which an informative target is compared with others again."""

    def __init__(
        self,
        residual_pose: Literal["pose", "surface", "constant"] = "surface",
        map_depth: DepthSource = "predicted",
        target: Literal["informative", "sampled", "greedy"] = "informative",
        temperature: float = 0.1,
        guidance: float = 2.0,
        view_guidance: float = 1.0,
        resolution: float = 0.05,
        max_range: float = 5.0,
        depth_error: float | None = None,
        max_incidence: float = 81.0,
        visited_is_free: bool = True,
        safety_margin: float = 0.05,
        unknown_traversable: bool = False,
        motion: Motion = "arcs",
        least_way: float = 1.5,
        per_action: bool = True,
        keep_targets: bool = False,
        revisits: bool = True,
        on_the_way: bool = True,
    ) -> None:
        super().__init__(
            map_depth,
            resolution,
            max_range,
            safety_margin,
            unknown_traversable,
            depth_option="deux's map_depth",
            motion=motion,
            least_way=least_way,
            depth_error=depth_error,
            max_incidence=max_incidence,
            visited_is_free=visited_is_free,
        )
        if residual_pose not in ("pose", "surface", "constant"):
            raise DeuxError(f'deux\'s residual_pose is "{residual_pose}": it must be "pose", "surface" or "constant".')
        if target not in ("informative", "sampled", "greedy"):
            raise DeuxError(f'deux\'s target is "{target}": it must be "informative", "sampled" or "greedy".')
        if not temperature > 0.0:  # false for NaN as well
            raise DeuxError(
                f'deux\'s temperature is {temperature}: it must be positive (target="greedy" is its limit).'
            )
        check_range("explore.guidance", guidance, 0.0)
        check_range("explore.view_guidance", view_guidance, 0.0)
        self.needs |= {Need.RESIDUAL}
        self._residual_pose: ResidualPlace = residual_pose
        self._target = target
        self._temperature = temperature
        self._guidance = guidance
        self._per_action = per_action
        self._keep_targets = keep_targets
        self._report_unused(
            temperature=temperature,
            guidance=guidance,
            least_way=least_way,
            keep_targets=keep_targets,
            view_guidance=view_guidance,
            revisits=revisits,
            on_the_way=on_the_way,
        )
        self._make_views = partial(
            InformativeTargets,
            residual_pose=residual_pose,
            guidance=view_guidance,
            per_action=per_action,
            revisits=revisits,
            on_the_way=on_the_way,
        )

    def _report_unused(self, **given: float) -> None:
        """Warn of options that the chosen kind of target does not have, if they are not the defaults."""
        unused = {"informative": OF_FRONTIERS, "sampled": OF_VIEWS, "greedy": (*OF_VIEWS, "temperature")}[self._target]
        defaults = options(DeuxExplorer)
        for name in unused:
            if given[name] != defaults[name].default:
                warn_once(log, f"explore.{name}={given[name]} has no effect with explore.target={self._target}.")

    def reset(self, episode: Episode) -> None:
        """Begin an episode."""
        super().reset(episode)
        self._field: ResidualField = (
            SurfaceResidualField(episode.camera, self._resolution)
            if self._residual_pose == "surface"
            else PoseResidualField()
        )
        self._views = self._make_views(episode, self.rng)
        self._until_review = self.review_interval

    def mapped(self, observation: Observation) -> None:
        """Record the frame's residual and view, before a target is chosen."""
        assert observation.residual is not None
        assert observation.uncertainty is not None
        self._pose = observation.pose
        record = observation.pose, self.map_depth(observation), observation.residual, observation.uncertainty
        if self._residual_pose != "constant":
            self._field.update(*record)
        if self._target == "informative":
            self._views.record(*record)
            self._views.mark_seen(observation.pose, self.occupancy.cells, self.occupancy.frame)

    def target_is_stale(self, target: Target) -> bool:
        """Whether another informative target is clearly better, or the target's frontier has come into view."""
        if self._target != "informative":
            return not self._keep_targets and self.frontier_is_resolved()
        self._until_review -= 1
        if self._until_review > 0:
            return False
        self._until_review = self.review_interval
        reach = self._reach(self.occupancy.frame.cell(self._pose[0, 3], self._pose[2, 3]))
        if reach is None:
            return False
        return self._views.is_outdone(target, self._map_now(self._pose, reach.candidates, reach.distance))

    def map(self) -> ExplorerMap | None:
        """The occupancy map with the uncertainty field over known cells."""
        known = super().map()
        if known is None:
            return None
        uncertainty = np.where(known.occupancy == UNKNOWN, np.float32(np.nan), self._field.grid(known.frame))
        return replace(known, uncertainty=uncertainty)

    def choose_target(self, pose: np.ndarray, candidates: FrontierCandidates, distance: np.ndarray) -> Target | None:
        """`SampleFrontiers`, then `SampleDepthGuidedTarget`."""
        frame = self.occupancy.frame
        if self._target == "informative":
            self._until_review = self.review_interval
            return self._views.choose(self._map_now(pose, candidates, distance))
        if len(candidates) == 0:
            places = self.free_places(distance, self.places_without_frontier)
            row, column = places[self._draw(self._field.at(cell_centres(frame, places)))]
            return Target(frame.centre(row, column))
        candidates = self._preferred(candidates)
        per_frontier = self.spacing / frame.resolution
        sampled = np.concatenate(
            [
                self.rng.choice(members, max(1, round(len(members) / per_frontier)), replace=False)
                for members in (np.flatnonzero(candidates.frontier == f) for f in np.unique(candidates.frontier))
            ]
        )
        candidates = candidates.select(sampled)
        return self.frontier_target(candidates, self._draw(self._worth(pose, candidates)))

    def _preferred(self, candidates: FrontierCandidates) -> FrontierCandidates:
        """The frontiers that are far enough away; all if a nearer one is clearly the most uncertain."""
        preferred = self.preferred_frontiers(candidates)
        if len(preferred) == len(candidates):
            return candidates
        of_all, of_preferred = (
            self._field.at(cell_centres(self.occupancy.frame, some.cells)).max() for some in (candidates, preferred)
        )
        return candidates if of_all > self.clearly * of_preferred else preferred

    def _worth(self, pose: np.ndarray, candidates: FrontierCandidates) -> np.ndarray:
        """The value w of each frontier cell, N float64: its uncertainty, per action."""
        uncertainty = self._field.at(cell_centres(self.occupancy.frame, candidates.cells))
        if not self._per_action:
            return uncertainty**self._guidance
        if uncertainty.max() <= 0.0:
            uncertainty = np.ones(len(candidates))
        return uncertainty**self._guidance / (self.actions_to(pose, candidates) + self.overhead)

    def _map_now(self, pose: np.ndarray, candidates: FrontierCandidates, distance: np.ndarray) -> MapNow:
        return MapNow(self.occupancy.cells, self.occupancy.frame, distance, pose, candidates.places)

    def _draw(self, worth: np.ndarray) -> int:
        """Sample the index of one of N places by their values."""
        largest = worth.max()
        if largest <= 0.0:
            return int(self.rng.integers(len(worth)))
        if self._target == "greedy":
            return int(np.argmax(worth))
        weights = (worth / largest) ** (1.0 / self._temperature)
        return int(self.rng.choice(len(worth), p=weights / weights.sum()))
