"""What an episode of exploration came to: measured alike for all explorers, whatever they make of what they see."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from deux.collection.free_floor import known_free_cells
from deux.contracts import DEPTH, Action, Channel, Channels, Episode, Frame, Need, Reward, Simulator
from deux.environment.egocentric import Crops
from deux.environment.memory import RESOLUTION, ExplorationMemory
from deux.geometry.grid import FreeSpace
from deux.geometry.poses import camera_pose
from deux.geometry.source_frames import SOURCES
from deux.mapping.occupancy import OccupancyMap
from deux.metrics.scorecard import PARALLAX

PIXELS = 64
"""Rows and columns of the images that are measured by: as many as learned explorers have in training."""

SEEN_PIXELS = 10
"""Pixels, of the 64 x 64 of a frame, in which an object has to appear to count as seen: a quarter of a percent."""

MEASURES = (
    "area_seen",
    "floor_covered",
    "objects_seen",
    "collisions",
    "path_length",
    "forward_share",
    "parallax_share",
)
"""An episode's numbers but for the rewards."""

REWARD = "reward_"
"""Prefix of the rewards among an episode's numbers."""

_BATCH = 32
"""Poses that are drawn at once."""


@dataclass(frozen=True)
class Exploration:
    """What one episode came to. The map is made of true depth and poses: cells of 0.1 m, seen from 3 m at most.

    Args:
        area_seen: square metres of the floor plan that the map knows, as free or as occupied.
        floor_covered: fraction of the floor on which the robot's centre could be that the map knows as free, 0 to 1.
        objects_seen: number of objects that filled at least `SEEN_PIXELS` pixels of some frame, counting only what
            lies within 3 m along the floor; None where nothing is labelled.
        collisions: number of actions that an obstacle cut short.
        path_length: metres that the robot moved.
        forward_share: fraction of the actions that were forward, 0 to 1.
        parallax_share: fraction of the frames that one of the two frames before them shows with parallax
            (`deux.metrics.scorecard.PARALLAX`), 0 to 1.
        rewards: the sum of each reward over the actions, by the reward's name.
    """

    area_seen: float
    floor_covered: float
    objects_seen: int | None
    collisions: int
    path_length: float
    forward_share: float
    parallax_share: float
    rewards: Mapping[str, float]

    def values(self) -> dict[str, float | None]:
        """All numbers in one dictionary, each reward after the prefix `REWARD`."""
        numbers: dict[str, Any] = asdict(self)
        rewards = numbers.pop("rewards")
        return {**numbers, **{REWARD + name: value for name, value in rewards.items()}}


@dataclass
class Track:
    """Where a robot went and what it did, frame by frame.

    Args:
        poses: 4 x 4 camera-to-world, of each frame.
        collided: of each frame, whether the action before it was cut short by an obstacle.
        actions: the answer to each frame.
    """

    poses: list[np.ndarray] = field(default_factory=list)
    collided: list[bool] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)

    def add(self, pose: np.ndarray, collided: bool, action: Action) -> None:
        """Note the next frame."""
        self.poses.append(pose)
        self.collided.append(collided)
        self.actions.append(action)

    @property
    def path_length(self) -> float:
        """Metres along the floor."""
        places = np.array(self.poses)[:, [0, 2], 3]
        return sum(np.hypot(*np.diff(places, axis=0).T).tolist())

    @property
    def forward_share(self) -> float:
        """Fraction of the actions that were forward."""
        return sum(action is Action.FORWARD for action in self.actions) / len(self.actions)

    @property
    def parallax_share(self) -> float:
        """Fraction of the frames with parallax to one of the two before them; the first frame has none before it."""
        pairs = [(pose, self.poses[max(0, i - SOURCES) : i]) for i, pose in enumerate(self.poses)]
        return sum(any(PARALLAX.apart(pose, source) for source in before) for pose, before in pairs) / len(self.poses)


def measure_exploration(
    simulator: Simulator, track: Track, rewards: Mapping[str, Reward], seed: int, steps: int, floor: int = 0
) -> Exploration:
    """Measure an episode that is over, by what a camera of `PIXELS` x `PIXELS` sees along its track.

    Args:
        simulator: of the episode's scene; its robot stays where it is.
        track: where the robot went; at least one frame.
        rewards: by name; each is made for this episode and has learned what it is to know. Those that need labels
            are left out where the scene has no objects.
        seed: the episode's.
        steps: its length.
        floor: its floor.
    """
    eye = _eye(simulator)
    objects = len(eye.object_labels)
    channels: Channels = frozenset({Channel.LABELS, Channel.OBJECTS}) if objects else DEPTH
    counted = {name: reward for name, reward in rewards.items() if objects or Need.LABELS not in reward.needs}
    for reward in counted.values():
        names = eye.label_names if Need.LABELS in reward.needs else ()
        reward.reset(Episode(seed, steps, eye.camera, eye.robot, label_names=names, floor=floor))
    memory = ExplorationMemory(eye.camera, eye.robot, Crops())
    sums = dict.fromkeys(counted, 0.0)
    found = _FoundObjects(eye, memory.occupancy.max_range)
    for step, frame in enumerate(_frames(eye, track.poses, channels)):
        if step > 0:
            memory.acted(track.actions[step - 1])
        experience = memory.experience(frame, track.collided[step])
        worth = {name: float(reward(experience)) for name, reward in counted.items()}
        if step > 0:  # the first look of an episode is no action's merit
            sums = {name: total + worth[name] for name, total in sums.items()}
        found.see(frame)
    return Exploration(
        area_seen=memory.area,
        floor_covered=floor_covered(memory.occupancy, simulator.free_space(floor)),
        objects_seen=found.count if objects else None,
        collisions=sum(track.collided),
        path_length=track.path_length,
        forward_share=track.forward_share,
        parallax_share=track.parallax_share,
        rewards=sums,
    )


def trajectory_map(simulator: Simulator, trajectory: Sequence[tuple[float, float, float]]) -> OccupancyMap:
    """The map of the true depth along a trajectory on the main floor, as `measure_exploration` makes it, for figures.

    Args:
        simulator: of the scene; its robot stays where it is.
        trajectory: x and z in metres and yaw in radians of each frame.
    """
    eye = _eye(simulator)
    space = eye.free_space()
    poses = [camera_pose(x, space.height_at(x, z) + eye.robot.camera_height, z, yaw) for x, z, yaw in trajectory]
    known = OccupancyMap(eye.camera, eye.robot, RESOLUTION)
    for frame in _frames(eye, poses, DEPTH):
        known.update(frame.depth, frame.pose)
    return known


def floor_covered(known: OccupancyMap, free_space: FreeSpace) -> float:
    """The fraction of the true free floor whose cells' centres lie where a map is free."""
    return known_free_cells(known, free_space.frame, free_space.free) / int(np.count_nonzero(free_space.free))


class _FoundObjects:
    """The objects that were near and large enough in some frame."""

    def __init__(self, eye: Simulator, max_range: float) -> None:
        self._max_range = max_range
        rays = eye.camera.rays()
        self._along_floor = np.hypot(rays[..., 0], rays[..., 2])  # metres for each metre of depth: the camera is level
        self._seen = np.zeros(len(eye.object_labels), bool)

    @property
    def count(self) -> int:
        """How many."""
        return int(self._seen.sum())

    def see(self, frame: Frame) -> None:
        """Count the objects of a frame; one without objects has none."""
        if frame.objects is not None:
            near = self._along_floor * frame.depth <= self._max_range
            pixels = np.bincount(frame.objects[near & (frame.objects >= 0)], minlength=len(self._seen))
            self._seen |= pixels >= SEEN_PIXELS


def _eye(simulator: Simulator) -> Simulator:
    """A robot in the same scene whose camera is the other's but for the number of pixels."""
    return simulator.another(replace(simulator.camera, width=PIXELS, height=PIXELS))


def _frames(simulator: Simulator, poses: Sequence[np.ndarray], channels: Channels) -> Iterator[Frame]:
    """What the camera records at each pose, drawn in batches."""
    for first in range(0, len(poses), _BATCH):
        yield from simulator.observe(channels, np.stack(poses[first : first + _BATCH]))
