import math

import numpy as np
import pytest

from deux.contracts import Action, Episode, Experience, Frame, Need, Reward, Robot
from deux.environment.exploration_env import ExplorationEnv
from deux.environment.memory import MOVES
from deux.environment.scene_pool import ScenePool
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace, GridFrame
from deux.geometry.poses import camera_pose
from deux.mapping.occupancy import OccupancyMap
from deux.registry import registry
from deux.scenes.sources import scene_splits
from deux.studies.exploration_meter import SEEN_PIXELS, Exploration, ExplorationMeter, floor_covered
from deux.studies.eye import Look, SceneEye
from deux.testing.box_world import Box, BoxWorld

CAMERA = Camera(64, 64)


class BoxEye:
    """Looks at a box world; all its boxes together are object 0, of two objects in the world."""

    camera = CAMERA
    label_names = BoxWorld.label_names
    objects = 2

    def __init__(self, world: BoxWorld) -> None:
        self.world = world

    def look(self, pose: np.ndarray) -> Look:
        self.world.reset(pose[0, 3], pose[2, 3], math.atan2(-pose[0, 2], -pose[2, 2]))
        frame = self.world.observe(labels=True)
        return Look(frame, frame.labels - 1)


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


def meter(world: BoxWorld, **rewards: Reward) -> ExplorationMeter:
    return ExplorationMeter(BoxEye(world), world.robot, rewards, seed=3, steps=50)


def turn_around(meter: ExplorationMeter, x: float, z: float) -> None:
    for step in range(36):
        meter.see(camera_pose(x, 1.25, z, step * math.radians(10.0)), collided=False)
        meter.acted(Action.LEFT)


def test_a_room_that_is_seen_whole():
    world = BoxWorld(3.0, 4.0, camera=CAMERA)
    free = world.free_space()
    measured = meter(world)
    turn_around(measured, 1.5, 2.0)
    found = measured.result(free)
    # The floor, 12 m², and the cells of 0.1 m that the walls' faces fall into.
    assert 12.0 <= found.area_seen <= 3.2 * 4.2
    assert found.floor_covered > 0.99
    assert (found.collisions, found.path_length, found.objects_seen) == (0, 0.0, 0)


def test_of_two_equal_rooms_without_a_door_one_is_half_of_the_floor():
    world = BoxWorld(6.1, 3.0, (Box(3.0, 0.0, 3.1, 3.0),), CAMERA)
    room = world.free_space()
    both = room.clearance >= world.robot.radius
    measured = meter(world)
    turn_around(measured, 1.5, 1.5)
    found = measured.result(FreeSpace(room.frame, both, room.clearance, 0.0))
    assert found.floor_covered == pytest.approx(0.5, abs=0.01)


def test_the_share_of_the_floor_counts_cells_outside_the_map_as_unseen():
    known = OccupancyMap(CAMERA, Robot())
    world = BoxWorld(2.0, 2.0, camera=CAMERA)
    world.reset(1.0, 1.0, 0.0)
    known.update(world.depth(), world.pose)
    far = GridFrame(100.0, 100.0, rows=4, columns=4)
    assert floor_covered(known, FreeSpace(far, np.ones(far.shape, bool), np.ones(far.shape), 0.0)) == 0.0


def test_path_and_collisions_and_actions():
    steps = Steps()
    measured = meter(BoxWorld(4.0, 4.0, camera=CAMERA), steps=steps)
    places = [(1.0, 1.0), (1.0, 1.25), (1.0, 1.25), (1.3, 1.65)]
    for number, (x, z) in enumerate(places):
        measured.see(camera_pose(x, 1.25, z, 0.0), collided=number == 2)
        if number < 3:
            measured.acted(MOVES[number])
    found = measured.result(BoxWorld(4.0, 4.0).free_space())
    assert found.path_length == pytest.approx(0.25 + 0.5)
    assert found.collisions == 1
    assert steps.actions == [None, 0, 1, 2]
    assert found.rewards == {"steps": 1.0 + 2.0 + 3.0}  # the first look is no action's
    assert found.values()["reward_steps"] == 6.0
    assert "rewards" not in found.values()


@pytest.mark.parametrize(("distance", "size", "seen"), [(2.5, 0.5, 1), (3.2, 0.5, 0), (2.5, 0.1, 0)])
def test_an_object_is_seen_when_it_is_near_and_large_enough(distance, size, seen):
    world = BoxWorld(4.0, 6.0, (Box(2.0 - size / 2, 0.5, 2.0 + size / 2, 1.0, height=size),), CAMERA)
    measured = meter(world)
    pose = camera_pose(2.0, 1.25, 1.0 + distance, 0.0)  # the box's front is at z = 1, straight ahead
    measured.see(pose, collided=False)
    pixels = np.count_nonzero(world.observe(labels=True).labels)
    assert (pixels >= SEEN_PIXELS) == (size > 0.2)
    assert measured.result(world.free_space()).objects_seen == seen


def test_a_scene_without_objects_leaves_out_what_needs_labels():
    class Unlabelled(BoxEye):
        label_names = ()
        objects = 0

        def look(self, pose: np.ndarray) -> Look:
            frame = super().look(pose).frame
            nothing = np.full(frame.depth.shape, -1)
            return Look(Frame(frame.rgb, frame.depth, pose, nothing), nothing)

    world = BoxWorld(3.0, 3.0, camera=CAMERA)
    rewards = {"any": Steps(), "labelled": Steps(frozenset({Need.LABELS}))}
    measured = ExplorationMeter(Unlabelled(world), world.robot, rewards, seed=0, steps=5)
    measured.see(camera_pose(1.5, 1.25, 1.5, 0.0), collided=False)
    found = measured.result(world.free_space())
    assert found.objects_seen is None
    assert found.rewards == {"any": 0.0}


def test_rewards_that_need_labels_are_told_their_names():
    rewards = {"any": Steps(), "labelled": Steps(frozenset({Need.LABELS}))}
    meter(BoxWorld(3.0, 3.0, camera=CAMERA), **rewards)
    assert rewards["any"].episode.label_names == ()
    assert rewards["labelled"].episode.label_names == ("room", "box")
    assert rewards["any"].episode.seed == 3


def test_it_measures_what_training_measures():
    """The area and the sums of the rewards are those of the environment in which policies are trained."""
    names = ["coverage", "novelty", "smooth_coverage", "semantic_reconstruction"]
    scenes = scene_splits({"source": "apartments", "test": 1}, ["test"]).test
    pool = ScenePool(CAMERA, Robot())
    actions = np.random.default_rng(0).integers(0, 3, 25)
    for name in names:
        env = ExplorationEnv(scenes, name, steps=30, pool=pool)
        env.reset(seed=1)
        poses, collisions, total = [env.simulator.pose], [False], 0.0
        for action in actions:
            _, reward, _, _, info = env.step(action)
            total += reward
            poses.append(env.simulator.pose)
            collisions.append(info["collided"])
        rewards = {name: registry().create("rewards", name, {})}
        measured = ExplorationMeter(SceneEye(env.simulator.scene, Camera()), Robot(), rewards, seed=1, steps=30)
        for pose, collided, action in zip(poses, collisions, [*actions, None], strict=True):
            measured.see(pose, collided)
            if action is not None:
                measured.acted(MOVES[action])
        found: Exploration = measured.result(env.simulator.free_space())
        assert found.rewards[name] == pytest.approx(total)
        assert found.area_seen == info["area_seen"]
        assert found.collisions == sum(collisions)
