"""What an episode of exploration is worth: measured alike for all explorers, whatever they make of what they see."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from deux.contracts import Action, Episode, Need, Reward, Robot
from deux.environment.egocentric import Crops
from deux.environment.memory import ExplorationMemory
from deux.geometry.grid import FreeSpace
from deux.mapping.occupancy import FREE, OccupancyMap
from deux.studies.eye import Eye, Look

SEEN_PIXELS = 10
"""Pixels, of the 64 x 64 of a frame, in which an object has to appear to count as seen: a quarter of a percent."""
MEASURES = ("area_seen", "floor_covered", "objects_seen", "collisions", "path_length")
"""An episode's numbers but for the rewards."""

REWARD = "reward_"
"""Prefix of the rewards among an episode's numbers."""


@dataclass(frozen=True)
class Exploration:
    """What one episode came to. The map is made of true depth and poses: cells of 0.1 m, seen from 3 m at most.

    Args:
        area_seen: square metres of the floor plan that the map knows, as free or as occupied.
        floor_covered: share of the floor on which the robot's centre could be that the map knows as free, 0 to 1.
        objects_seen: number of objects that filled at least `SEEN_PIXELS` pixels of some frame, counting only what
            lies within 3 m along the floor; None where nothing is labelled.
        collisions: number of actions that an obstacle cut short.
        path_length: metres that the robot moved.
        rewards: the sum of each reward over the actions, by the reward's name.
    """

    area_seen: float
    floor_covered: float
    objects_seen: int | None
    collisions: int
    path_length: float
    rewards: Mapping[str, float]

    def values(self) -> dict[str, float | None]:
        """All numbers in one dictionary, each reward after the prefix `REWARD`."""
        numbers: dict[str, Any] = asdict(self)
        rewards = numbers.pop("rewards")
        return {**numbers, **{REWARD + name: value for name, value in rewards.items()}}


class ExplorationMeter:
    """Measures one episode as it goes on.

    Args:
        eye: looks at the scene.
        robot: the robot's body.
        rewards: by name; each is made for this episode and has learned what it is to know. Those that need labels
            are left out where the scene has no objects.
        seed: the episode's.
        steps: its length.
    """

    def __init__(self, eye: Eye, robot: Robot, rewards: Mapping[str, Reward], seed: int, steps: int) -> None:
        self._eye = eye
        self._memory = ExplorationMemory(eye.camera, robot, Crops())
        rays = eye.camera.rays()
        self._along_floor = np.hypot(rays[..., 0], rays[..., 2])  # metres for each metre of depth: the camera is level
        self._rewards = {name: r for name, r in rewards.items() if eye.objects or Need.LABELS not in r.needs}
        for reward in self._rewards.values():
            names = eye.label_names if Need.LABELS in reward.needs else ()
            reward.reset(Episode(seed, steps, eye.camera, robot, label_names=names))
        self._sums = dict.fromkeys(self._rewards, 0.0)
        self._seen = np.zeros(eye.objects, bool)
        self._collisions = 0
        self._path_length = 0.0
        self._place: np.ndarray | None = None

    def see(self, pose: np.ndarray, collided: bool) -> None:
        """Look from where the robot is now.

        Args:
            pose: 4 x 4 camera-to-world.
            collided: whether the last action was cut short.
        """
        look = self._eye.look(pose)
        experience = self._memory.experience(look.frame, collided)
        worth = {name: float(reward(experience)) for name, reward in self._rewards.items()}
        place = pose[[0, 2], 3].copy()
        if self._place is not None:  # the first look of an episode is no action's merit
            self._sums = {name: total + worth[name] for name, total in self._sums.items()}
            self._path_length += float(np.hypot(*(place - self._place)))
        self._place = place
        self._collisions += collided
        self._see_objects(look)

    def acted(self, action: Action) -> None:
        """Note what the explorer does next; only if a look follows."""
        self._memory.acted(action)

    def result(self, free_space: FreeSpace) -> Exploration:
        """What the episode came to.

        Args:
            free_space: the scene's true free floor.
        """
        return Exploration(
            area_seen=self._memory.area,
            floor_covered=floor_covered(self._memory.occupancy, free_space),
            objects_seen=int(self._seen.sum()) if self._eye.objects else None,
            collisions=self._collisions,
            path_length=self._path_length,
            rewards=self._sums,
        )

    def _see_objects(self, look: Look) -> None:
        near = self._along_floor * look.frame.depth <= self._memory.occupancy.max_range
        pixels = np.bincount(look.objects[near & (look.objects >= 0)], minlength=len(self._seen))
        self._seen |= pixels >= SEEN_PIXELS


def floor_covered(known: OccupancyMap, free_space: FreeSpace) -> float:
    """The share of the true free floor whose cells' centres lie where a map is free."""
    frame = free_space.frame
    rows, columns = np.nonzero(free_space.free)
    x = frame.origin_x + (columns + 0.5) * frame.resolution
    z = frame.origin_z + (rows + 0.5) * frame.resolution
    rows, columns = known.frame.cells(x, z)
    inside = known.frame.contains(rows, columns)
    return float(np.count_nonzero(known.cells[rows[inside], columns[inside]] == FREE) / len(rows))
