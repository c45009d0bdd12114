"""Exploration metrics of an episode, computed in the same way for all explorers."""

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
"""Height and width of the images used for measuring; the same as in the training of learned explorers."""

SEEN_PIXELS = 10
"""Minimal number of pixels of an object, of the 64 x 64 of a frame, to count as seen: a quarter of a percent."""

MEASURES = (
    "area_seen",
    "floor_covered",
    "objects_seen",
    "collisions",
    "path_length",
    "forward_share",
    "parallax_share",
)
"""The metrics of an episode, without the rewards."""

REWARD = "reward_"
"""Prefix of the rewards among the metrics of an episode."""

_BATCH = 32
"""Number of poses that are rendered at once."""


@dataclass(frozen=True)
class Exploration:
    """Metrics of one episode. The map is built from true depth and poses, with cells of 0.1 m and a range of 3 m.

    Args:
        area_seen: area of the floor plan that is free or occupied in the map, square metres.
        floor_covered: fraction of the floor that the robot's centre can reach that is free in the map, in [0, 1].
        objects_seen: number of objects with at least `SEEN_PIXELS` pixels in a frame, counting pixels within 3 m along
            the floor only; None if the scene has no labels.
        collisions: number of actions that an obstacle cut short.
        path_length: length of the robot's path, metres.
        forward_share: fraction of forward actions, in [0, 1].
        parallax_share: fraction of the frames with parallax (`deux.metrics.scorecard.PARALLAX`) to one of the two
            frames before them, in [0, 1].
        rewards: sum of each reward over the actions, by the reward's name.
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
        """All metrics in one dictionary; names of rewards have the prefix `REWARD`."""
        metrics: dict[str, Any] = asdict(self)
        rewards = metrics.pop("rewards")
        return {**metrics, **{REWARD + name: value for name, value in rewards.items()}}


@dataclass
class Track:
    """Poses and actions of a robot, frame by frame.

    Args:
        poses: 4 x 4 camera-to-world pose of each frame.
        collided: for each frame, whether the action before it was cut short by an obstacle.
        actions: the action after each frame.
    """

    poses: list[np.ndarray] = field(default_factory=list)
    collided: list[bool] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)

    def add(self, pose: np.ndarray, collided: bool, action: Action) -> None:
        """Add the next frame."""
        self.poses.append(pose)
        self.collided.append(collided)
        self.actions.append(action)

    @property
    def path_length(self) -> float:
        """Length of the path along the floor, metres."""
        positions = np.array(self.poses)[:, [0, 2], 3]
        return sum(np.hypot(*np.diff(positions, axis=0).T).tolist())

    @property
    def forward_share(self) -> float:
        """Fraction of forward actions."""
        return sum(action is Action.FORWARD for action in self.actions) / len(self.actions)

    @property
    def parallax_share(self) -> float:
        """Fraction of the frames with parallax to one of the two frames before them."""
        pairs = [(pose, self.poses[max(0, i - SOURCES) : i]) for i, pose in enumerate(self.poses)]
        return sum(any(PARALLAX.apart(pose, source) for source in before) for pose, before in pairs) / len(self.poses)


def measure_exploration(
    simulator: Simulator, track: Track, rewards: Mapping[str, Reward], seed: int, steps: int, floor: int = 0
) -> Exploration:
    """Compute the metrics of a finished episode, by rendering the frames along its track with a small camera.

    Args:
        simulator: simulator of the episode's scene; its robot is not moved.
        track: the robot's track; at least one frame.
        rewards: rewards by name, created for this episode, with their learned states. Those that need labels are left
            out if the scene has no objects.
        seed: seed of the episode.
        steps: length of the episode.
        floor: floor of the episode.
    """
    camera = _measuring_simulator(simulator)
    objects = len(camera.object_labels)
    channels: Channels = frozenset({Channel.LABELS, Channel.OBJECTS}) if objects else DEPTH
    used = {name: reward for name, reward in rewards.items() if objects or Need.LABELS not in reward.needs}
    for reward in used.values():
        names = camera.label_names if Need.LABELS in reward.needs else ()
        reward.reset(Episode(seed, steps, camera.camera, camera.robot, label_names=names, floor=floor))
    memory = ExplorationMemory(camera.camera, camera.robot, Crops())
    sums = dict.fromkeys(used, 0.0)
    seen = _SeenObjects(camera, memory.occupancy.max_range)
    for step, frame in enumerate(_frames(camera, track.poses, channels)):
        if step > 0:
            memory.acted(track.actions[step - 1])
        experience = memory.experience(frame, track.collided[step])
        values = {name: float(reward(experience)) for name, reward in used.items()}
        if step > 0:  # the first frame is not the result of an action
            sums = {name: total + values[name] for name, total in sums.items()}
        seen.add(frame)
    return Exploration(
        area_seen=memory.area,
        floor_covered=floor_covered(memory.occupancy, simulator.free_space(floor)),
        objects_seen=seen.count if objects else None,
        collisions=sum(track.collided),
        path_length=track.path_length,
        forward_share=track.forward_share,
        parallax_share=track.parallax_share,
        rewards=sums,
    )


def trajectory_map(simulator: Simulator, trajectory: Sequence[tuple[float, float, float]]) -> OccupancyMap:
    """The map of the true depth along a trajectory on the main floor, as in `measure_exploration`, for figures.

    Args:
        simulator: simulator of the scene; its robot is not moved.
        trajectory: x and z in metres and yaw in radians of each frame.
    """
    camera = _measuring_simulator(simulator)
    space = camera.free_space()
    poses = [camera_pose(x, space.height_at(x, z) + camera.robot.camera_height, z, yaw) for x, z, yaw in trajectory]
    occupancy = OccupancyMap(camera.camera, camera.robot, RESOLUTION)
    for frame in _frames(camera, poses, DEPTH):
        occupancy.update(frame.depth, frame.pose)
    return occupancy


def floor_covered(occupancy: OccupancyMap, free_space: FreeSpace) -> float:
    """The fraction of the true free floor, by centres of its cells, that is free in a map."""
    return known_free_cells(occupancy, free_space.frame, free_space.free) / int(np.count_nonzero(free_space.free))


class _SeenObjects:
    """Counts the objects that were near and large enough in a frame."""

    def __init__(self, simulator: Simulator, max_range: float) -> None:
        self._max_range = max_range
        rays = simulator.camera.rays()
        # Distance along the floor per metre of depth, as the camera is level.
        self._along_floor = np.hypot(rays[..., 0], rays[..., 2])
        self._seen = np.zeros(len(simulator.object_labels), bool)

    @property
    def count(self) -> int:
        """Number of objects seen so far."""
        return int(self._seen.sum())

    def add(self, frame: Frame) -> None:
        """Add the objects of a frame, if it has any."""
        if frame.objects is not None:
            near = self._along_floor * frame.depth <= self._max_range
            pixels = np.bincount(frame.objects[near & (frame.objects >= 0)], minlength=len(self._seen))
            self._seen |= pixels >= SEEN_PIXELS


def _measuring_simulator(simulator: Simulator) -> Simulator:
    """A simulator of the same scene with the resolution of `PIXELS`."""
    return simulator.another(replace(simulator.camera, width=PIXELS, height=PIXELS))


def _frames(simulator: Simulator, poses: Sequence[np.ndarray], channels: Channels) -> Iterator[Frame]:
    """Render the frame at each pose, in batches."""
    for first in range(0, len(poses), _BATCH):
        yield from simulator.observe(channels, np.stack(poses[first : first + _BATCH]))
