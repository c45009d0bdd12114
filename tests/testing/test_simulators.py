"""The suite must fail for simulators that break the contract, each in the test that is meant for it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from deux.contracts import Action, Channel, Floor, Robot
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.testing.box_world import Box, BoxWorld
from deux.testing.simulators import SimulatorSuite

ROOM = (6.0, 5.0, (Box(4.0, 1.0, 5.0, 2.0, 0.9), Box(1.0, 3.5, 2.0, 4.0)))


class BrokenWorld(BoxWorld):
    """A room with boxes, with one thing wrong."""

    def __init__(self, fault, camera, robot=None):
        super().__init__(*ROOM, camera, robot)
        self.fault = fault
        self.kept = {}
        if fault == "no scene":
            self.scene = "boxes"
        if fault == "a floor twice":
            self.floors = (Floor(0.0, 30.0), Floor(0.0, 30.0))
        if fault == "wrong intrinsics":
            self._rays = Camera(camera.width, camera.height, hfov=70.0).rays()

    @property
    def object_labels(self):
        return ("table", "box") if self.fault == "other object labels" else super().object_labels

    @property
    def pose(self):
        pose = super().pose
        if self.fault == "tilted":
            pose[:3, :3] = pose[:3, :3] @ [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]
        if self.fault == "camera at its feet":
            pose[1, 3] = 0.0
        if self.fault == "shares its pose":
            pose = self.kept.setdefault((self._x, self._z, self._yaw), pose)
        return pose

    def reset(self, x, z, yaw, floor=0):
        if self.fault == "goes anywhere":
            self._x, self._z, self._yaw = x, z, yaw
        else:
            super().reset(x, z, yaw, floor)

    def step(self, action):
        if self.fault == "turns the wrong way" and action in (Action.LEFT, Action.RIGHT):
            action = Action.LEFT if action is Action.RIGHT else Action.RIGHT
        if self.fault == "stops with a step" and action is Action.STOP:
            action = Action.FORWARD
        if self.fault == "passes through walls" and action is Action.FORWARD:
            self._x -= self.robot.forward_step * math.sin(self._yaw)
            self._z -= self.robot.forward_step * math.cos(self._yaw)
            return False
        collided = super().step(action)
        return (action is Action.FORWARD) if self.fault == "always collides" else collided

    def render(self, poses, channels):
        if self.fault == "labels unasked":
            channels = channels | {Channel.LABELS}
        frames = super().render(poses, channels)
        if self.fault == "noise":
            frames = [
                replace(f, depth=f.depth * (1 - 0.1 * np.random.rand(*f.depth.shape)).astype("f4")) for f in frames
            ]
        if self.fault == "moves to draw" and len(poses):
            self._x, self._z = poses[0][[0, 2], 3]
        if self.fault == "infinite depth":
            frames = [replace(f, depth=np.where(f.depth > 0, f.depth, np.float32(np.inf))) for f in frames]
        if self.fault == "labels without names" and Channel.LABELS in channels:
            frames = [replace(f, labels=f.labels + 1) for f in frames]
        return frames

    def free_space(self, floor=0):
        space = super().free_space(floor)
        if self.fault == "free space in pieces":
            space.free[:, space.frame.columns // 2] = False
        if self.fault == "heights unknown":
            space.heights[space.frame.rows // 2] = np.nan
        return space

    def another(self, camera=None):
        if self.fault == "another is itself":
            return self
        return BrokenWorld(self.fault, camera or self.camera, self.robot)


def run(fault, test):
    suite = SimulatorSuite()
    suite.make_simulator = lambda camera: BrokenWorld(fault, camera)
    getattr(suite, test)()


TESTS = [name for name in dir(SimulatorSuite) if name.startswith("test_")]


@pytest.mark.parametrize("test", TESTS)
def test_a_sound_simulator_passes(test):
    run("none", test)


@pytest.mark.parametrize(
    ("fault", "test"),
    [
        ("no scene", "test_keeps_what_it_was_made_with"),
        ("a floor twice", "test_lists_its_floors"),
        ("free space in pieces", "test_free_space_is_one_connected_region"),
        ("heights unknown", "test_free_space_is_one_connected_region"),
        ("tilted", "test_stands_where_it_is_put"),
        ("camera at its feet", "test_stands_where_it_is_put"),
        ("goes anywhere", "test_refuses_a_place_off_the_floor"),
        ("turns the wrong way", "test_turns_on_the_spot"),
        ("stops with a step", "test_turns_on_the_spot"),
        ("passes through walls", "test_moves_forward_or_collides"),
        ("always collides", "test_moves_forward_or_collides"),
        ("passes through walls", "test_never_leaves_the_free_floor"),
        ("labels unasked", "test_frames_hold_what_is_asked_for"),
        ("infinite depth", "test_depth_is_in_range_or_zero"),
        ("labels without names", "test_labels_and_objects_have_names"),
        ("other object labels", "test_labels_and_objects_have_names"),
        ("noise", "test_a_batch_is_its_single_frames"),
        ("moves to draw", "test_a_batch_is_its_single_frames"),
        ("wrong intrinsics", "test_depth_agrees_between_views"),
        ("shares its pose", "test_what_it_returns_is_the_callers"),
        ("another is itself", "test_another_robot_is_independent"),
    ],
)
def test_a_broken_simulator_fails(fault, test):
    # The second is `pytest.raises` that saw no error, the last a value that `Simulator.observe` refuses.
    with pytest.raises((AssertionError, pytest.fail.Exception, DeuxError)):
        run(fault, test)


def test_the_suite_asks_for_the_robots_own_step_and_angle():
    suite = SimulatorSuite()
    suite.make_simulator = lambda camera: BoxWorld(*ROOM, camera, Robot(forward_step=0.1, turn_angle=30.0))
    suite.test_turns_on_the_spot()
    suite.test_moves_forward_or_collides()
