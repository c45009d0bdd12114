import math
from collections.abc import Sequence

import numpy as np
import pytest

from deux.contracts import Action, Channel, Channels, Episode, Experience, Frame, Need, Reward, Robot
from deux.environment.exploration_env import ExplorationEnv
from deux.environment.memory import MOVES
from deux.environment.scene_pool import ScenePool
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace, GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.occupancy import OCCUPIED, OccupancyMap
from deux.registry import registry
from deux.simulator.simulation import Simulation
from deux.studies.exploration_meter import (
    PIXELS,
    SEEN_PIXELS,
    Exploration,
    Track,
    floor_covered,
    measure_exploration,
    trajectory_map,
)
from deux.testing.box_world import Box, BoxWorld

CAMERA = Camera(48, 40)
EYE = Camera(PIXELS, PIXELS)


class Steps(Reward):
    """The number of each look; it notes the actions that led there."""

    def __init__(self, needs: frozenset[Need] = frozenset()) -> None:
        self.needs = needs

    def reset(self, episode: Episode) -> None:
        self.episode = episode
        self.actions: list[int | None] = []

    def __call__(self, experience: Experience) -> float:
        self.actions.append(experience.action)
        return float(experience.observation.step)


def track(
    poses: Sequence[np.ndarray], collided: Sequence[bool] | None = None, actions: Sequence[Action] | None = None
) -> Track:
    return Track(list(poses), list(collided or [False] * len(poses)), list(actions or [Action.LEFT] * len(poses)))


def turn_around(x: float, z: float) -> Track:
    return track([camera_pose(x, 1.25, z, step * math.radians(10.0)) for step in range(36)])


def measure(world: BoxWorld, walked: Track, **rewards: Reward) -> Exploration:
    return measure_exploration(world, walked, rewards, seed=3, steps=50)


def test_a_room_that_is_seen_whole():
    found = measure(BoxWorld(3.0, 4.0, camera=CAMERA), turn_around(1.5, 2.0))
    # The floor, 12 m², and the cells of 0.1 m that the walls' faces fall into.
    assert 12.0 <= found.area_seen <= 3.2 * 4.2
    assert found.floor_covered > 0.99
    assert (found.collisions, found.path_length, found.objects_seen) == (0, 0.0, None)


def test_of_two_equal_rooms_without_a_door_one_is_half_of_the_floor():
    class BothRooms(BoxWorld):
        def free_space(self, floor: int = 0) -> FreeSpace:
            room = super().free_space(floor)
            return FreeSpace(room.frame, room.clearance >= self.robot.radius, room.clearance, 0.0)

    world = BothRooms(6.1, 3.0, (Box(3.0, 0.0, 3.1, 3.0),), CAMERA)
    assert measure(world, turn_around(1.5, 1.5)).floor_covered == pytest.approx(0.5, abs=0.01)


def test_the_covered_floor_counts_cells_outside_the_map_as_unseen():
    world = BoxWorld(2.0, 2.0, camera=EYE)
    world.reset(1.0, 1.0, 0.0)
    known = OccupancyMap(EYE, Robot())
    known.update(world.observe(frozenset()).depth, world.pose)
    far = GridFrame(100.0, 100.0, rows=4, columns=4)
    assert floor_covered(known, FreeSpace(far, np.ones(far.shape, bool), np.ones(far.shape), 0.0)) == 0.0


def test_path_and_collisions_and_actions():
    steps = Steps()
    places = [(1.0, 1.0), (1.0, 1.25), (1.0, 1.25), (1.3, 1.65)]
    walked = track(
        [camera_pose(x, 1.25, z, 0.0) for x, z in places],
        collided=[False, False, True, False],
        actions=[*MOVES, Action.STOP],
    )
    found = measure(BoxWorld(4.0, 4.0, camera=CAMERA), walked, steps=steps)
    assert found.path_length == pytest.approx(0.25 + 0.5)
    assert found.collisions == 1
    assert steps.actions == [None, 0, 1, 2]
    assert found.rewards == {"steps": 1.0 + 2.0 + 3.0}  # the first look is no action's
    assert found.values()["reward_steps"] == 6.0
    assert "rewards" not in found.values()


@pytest.mark.parametrize(
    ("actions", "parallax"),
    [
        ("FFFF", [0, 1, 1, 1]),
        ("FLLL", [0, 1, 1, 0]),  # the fourth frame and the two before it are at one place
        ("LLLL", [0, 0, 0, 0]),
        ("FLLLLLF", [0, 1, 1, 0, 0, 0, 0]),  # the last action is not carried out
    ],
)
def test_shares_of_forward_actions_and_of_frames_with_parallax(actions, parallax):
    robot = Robot()
    x, z, yaw, poses = 2.0, 2.0, 0.0, []
    for action in actions:
        poses.append(camera_pose(x, 1.25, z, yaw))
        if action == "F":
            x, z = x - robot.forward_step * math.sin(yaw), z - robot.forward_step * math.cos(yaw)
        else:
            yaw += math.radians(robot.turn_angle)
    walked = track(poses, actions=[Action.FORWARD if action == "F" else Action.LEFT for action in actions])
    assert walked.forward_share == pytest.approx(actions.count("F") / len(actions))
    assert walked.parallax_share == pytest.approx(sum(parallax) / len(actions))


@pytest.mark.parametrize(("distance", "size", "seen"), [(2.5, 0.5, 1), (3.2, 0.5, 0), (2.5, 0.1, 0)])
def test_an_object_is_seen_when_it_is_near_and_large_enough(distance, size, seen):
    box = Box(2.0 - size / 2, 0.5, 2.0 + size / 2, 1.0, height=size)
    behind = Box(0.2, 5.5, 0.6, 5.9)
    world = BoxWorld(4.0, 6.0, (box, behind), CAMERA)
    pose = camera_pose(2.0, 1.25, 1.0 + distance, 0.0)  # the box's front is at z = 1, straight ahead
    (frame,) = world.another(EYE).observe(frozenset({Channel.OBJECTS}), pose[None])
    assert (np.count_nonzero(frame.objects == 0) >= SEEN_PIXELS) == (size > 0.2)
    assert measure(world, track([pose])).objects_seen == seen


def test_objects_are_counted_one_by_one_and_each_once():
    """Four boxes in the corners of a room, of which a robot sees those that it turns to."""
    corners = [(0.2, 0.2), (3.4, 0.2), (0.2, 3.4), (3.4, 3.4)]
    world = BoxWorld(4.0, 4.0, tuple(Box(x, z, x + 0.4, z + 0.4, 0.8) for x, z in corners), CAMERA)
    ahead = camera_pose(2.0, 1.25, 2.0, 0.0)  # towards -Z, where two of them stand
    assert measure(world, track([ahead] * 3)).objects_seen == 2
    assert measure(world, turn_around(2.0, 2.0)).objects_seen == 4


def test_a_scene_without_objects_leaves_out_what_needs_labels():
    rewards = {"any": Steps(), "labelled": Steps(frozenset({Need.LABELS}))}
    found = measure(BoxWorld(3.0, 3.0, camera=CAMERA), track([camera_pose(1.5, 1.25, 1.5, 0.0)]), **rewards)
    assert found.objects_seen is None
    assert found.rewards == {"any": 0.0}


def test_rewards_that_need_labels_get_their_names():
    rewards = {"any": Steps(), "labelled": Steps(frozenset({Need.LABELS}))}
    world = BoxWorld(3.0, 3.0, (Box(0.2, 0.2, 0.5, 0.5),), CAMERA)
    measure(world, turn_around(1.5, 1.5), **rewards)
    assert rewards["any"].episode.label_names == ()
    assert rewards["labelled"].episode.label_names == ("room", "box")
    assert (rewards["any"].episode.seed, rewards["any"].episode.camera) == (3, EYE)


def test_poses_are_drawn_in_batches_and_without_colours():
    class Noting(BoxWorld):
        asked: list[tuple[int, Channels]] = []  # noqa: RUF012

        def render(self, poses: np.ndarray, channels: Channels) -> list[Frame]:
            self.asked.append((len(poses), channels))
            return super().render(poses, channels)

        def another(self, camera: Camera | None = None) -> BoxWorld:
            return Noting(self.width, self.length, self.boxes, camera or self.camera, self.robot)

    measure(Noting(4.0, 4.0, camera=CAMERA), turn_around(2.0, 2.0))
    assert Noting.asked == [(32, frozenset()), (4, frozenset())]


def test_the_map_of_a_trajectory_is_that_of_its_depth():
    """A trajectory that turns once around in a room: the floor is known and the walls stand around it."""
    world = BoxWorld(3.0, 4.0, camera=CAMERA)
    known = trajectory_map(world, [(1.5, 2.0, math.radians(10.0 * step)) for step in range(36)])
    assert np.count_nonzero(known.cells) * known.resolution**2 == measure(world, turn_around(1.5, 2.0)).area_seen
    rows, columns = np.nonzero(known.cells == OCCUPIED)
    x = known.frame.origin_x + (columns + 0.5) * known.resolution
    z = known.frame.origin_z + (rows + 0.5) * known.resolution
    to_wall = np.abs(np.stack([x, 3.0 - x, z, 4.0 - z])).min(axis=0)
    assert to_wall.max() < 0.11


def test_it_measures_what_training_measures():
    """The area and the sums of the rewards are those of the environment in which policies are trained."""
    names = ["coverage", "novelty", "smooth_coverage", "semantic_reconstruction"]
    scenes = registry().create("scenes", "apartments", {"test": 1}).splits().test
    simulation = Simulation(Camera(PIXELS, PIXELS), Robot(), registry().choose("simulators", {"name": "mesh"}))
    pool = ScenePool(simulation, colors=False)
    actions = np.random.default_rng(0).integers(0, 3, 25)
    for name in names:
        env = ExplorationEnv(scenes, name, steps=30, pool=pool)
        env.reset(seed=1)
        walked, total = Track(), 0.0
        pose, collided = env.simulator.pose, False
        for action in actions:
            walked.add(pose, collided, MOVES[action])
            _, reward, _, _, info = env.step(action)
            total += reward
            pose, collided = env.simulator.pose, info["collided"]
        walked.add(pose, collided, Action.STOP)
        simulator = pool.simulator(scenes[0]).another(Camera(100, 80))
        rewards = {name: registry().create("rewards", name, {})}
        found = measure_exploration(simulator, walked, rewards, seed=1, steps=30)
        assert found.rewards[name] == pytest.approx(total)
        assert found.area_seen == info["area_seen"]
        assert found.collisions == sum(walked.collided)
        assert found.objects_seen > 0
