"""Conformance suite for simulators: tests of the contract of `deux.contracts.Simulator`.

A plugin's test file subclasses it, and pytest runs the whole suite:

    class TestMySimulator(SimulatorSuite):
        def make_simulator(self, camera: Camera) -> Simulator:
            return MySimulator(scene, camera, Robot())

The scene can be any closed, furnished scene with one or several floors. Each test creates a simulator; load a scene
that is slow to load once, and return `another(camera)` of its simulator for each test.
"""

import math
from itertools import chain, combinations
from typing import ClassVar

import numpy as np
import pytest
from scipy import ndimage

from deux.contracts import COLOR, DEPTH, Action, Channel, Channels, Frame, SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.grid import FreeSpace
from deux.geometry.poses import inverse, yaw_of
from deux.simulator.starts import random_starts

CAMERA = Camera(48, 40)
EVERYTHING: Channels = frozenset(Channel)

Start = tuple[float, float, float]
"""World x and z in metres, and the heading in radians."""


def starts(simulator: Simulator, count: int, floor: int = 0) -> list[Start]:
    """Return the first `count` of 16 random starts on a floor, which are the same in each call."""
    return random_starts(simulator.free_space(floor), 16, np.random.default_rng(0))[:count]


def assert_same(first: Frame, second: Frame) -> None:
    """Assert that all arrays of two frames are bitwise equal."""
    for name in ("rgb", "depth", "pose", "labels", "objects"):
        one, other = getattr(first, name), getattr(second, name)
        assert (one is None) == (other is None), f"one frame has {name} and the other has none"
        if one is not None:
            np.testing.assert_array_equal(one, other, err_msg=f"{name} differs")


class SimulatorSuite:
    """Base class of the tests of a simulator. Subclasses define `make_simulator`.

    Set `position_tolerance`, in metres, for a simulator that moves the robot less exactly.
    """

    position_tolerance: ClassVar[float] = 1e-3

    def make_simulator(self, camera: Camera) -> Simulator:
        """Create the simulator to test; the initial pose of the robot does not matter."""
        raise NotImplementedError

    def placed(self, camera: Camera = CAMERA) -> Simulator:
        """Create a simulator whose robot stands on the main floor."""
        simulator = self.make_simulator(camera)
        simulator.reset(*starts(simulator, 1)[0])
        return simulator

    def test_keeps_what_it_was_made_with(self) -> None:
        """`camera` and `scene` are those of the simulator, and all names of labels are text."""
        simulator = self.make_simulator(CAMERA)
        assert simulator.camera == CAMERA
        assert isinstance(simulator.scene, SceneReference)
        for names in (simulator.label_names, simulator.object_labels):
            assert isinstance(names, tuple)
            assert all(isinstance(name, str) for name in names), f"not all of {names} are text"

    def test_lists_its_floors(self) -> None:
        """There is at least one floor, all floors differ in height, and the first one is the default."""
        simulator = self.make_simulator(CAMERA)
        heights = [floor.height for floor in simulator.floors]
        assert heights, "there is no floor"
        assert len(set(heights)) == len(heights), f"a floor is listed twice: {heights}"
        assert all(floor.area > 0.0 and math.isfinite(floor.height) for floor in simulator.floors)
        first = simulator.free_space(0)
        np.testing.assert_array_equal(simulator.free_space().free, first.free, "the first floor is not the default")

    def test_free_space_is_one_connected_region(self) -> None:
        """The free space of every floor is one non-empty region near its height, with clearance and surface heights."""
        simulator = self.make_simulator(CAMERA)
        for number, floor in enumerate(simulator.floors):
            space = simulator.free_space(number)
            assert space.free.shape == space.clearance.shape == space.frame.shape
            assert space.free.any(), f"floor {number} has no free cell"
            assert ndimage.label(space.free, np.ones((3, 3)))[1] == 1, f"floor {number} is in several pieces"
            assert space.floor_height == pytest.approx(floor.height, abs=simulator.robot.max_climb)
            assert space.clearance[space.free].min() > 0.0, "a free cell has no clearance"
            assert (space.heights.shape, space.heights.dtype) == (space.frame.shape, np.float32)
            known = np.isfinite(space.heights)
            np.testing.assert_array_equal(known, space.free, "heights are not known in just the free cells")

    def test_stands_where_it_is_put(self) -> None:
        """After `reset`, the pose is rigid and level, at the given position and the camera's height above the floor."""
        simulator = self.make_simulator(CAMERA)
        for number in range(len(simulator.floors)):
            space = simulator.free_space(number)
            for x, z, yaw in starts(simulator, 8, number):
                simulator.reset(x, z, yaw, number)
                pose = simulator.pose
                _check_rigid_and_level(pose)
                assert pose[[0, 2], 3] == pytest.approx((x, z), abs=self.position_tolerance)
                height = space.height_at(x, z) + simulator.robot.camera_height
                assert pose[1, 3] == pytest.approx(height, abs=simulator.robot.max_climb)
                assert _turned(yaw, yaw_of(pose)) == pytest.approx(0.0, abs=1e-3)

    def test_refuses_a_place_off_the_floor(self) -> None:
        """Positions outside the scene or in obstacles, and floors that do not exist, raise DeuxError."""
        simulator = self.make_simulator(CAMERA)
        x, z, yaw = starts(simulator, 1)[0]
        space = simulator.free_space()
        blocked = np.argwhere(space.clearance <= 0.0)
        outside = (space.frame.origin_x - 10.0, space.frame.origin_z - 10.0)
        inside = [space.frame.centre(*cell) for cell in blocked[:: max(1, len(blocked) // 5)]]
        for place in (outside, *inside):
            with pytest.raises(DeuxError):
                simulator.reset(*place, yaw)
        for floor in (len(simulator.floors), -1):
            with pytest.raises(DeuxError):
                simulator.reset(x, z, yaw, floor)
            with pytest.raises(DeuxError):
                simulator.free_space(floor)

    def test_turns_on_the_spot(self) -> None:
        """LEFT and RIGHT turn by the robot's turn angle and STOP does nothing; none of them moves or collides."""
        simulator = self.placed()
        angle = math.radians(simulator.robot.turn_angle)
        for action, expected in ((Action.LEFT, angle), (Action.RIGHT, -angle), (Action.STOP, 0.0)):
            before = simulator.pose
            assert not simulator.step(action), f"{action.name} collided"
            after = simulator.pose
            _check_rigid_and_level(after)
            np.testing.assert_allclose(after[:3, 3], before[:3, 3], atol=self.position_tolerance)
            assert _turned(yaw_of(before), yaw_of(after)) == pytest.approx(expected, abs=1e-3)

    def test_moves_forward_or_collides(self) -> None:
        """FORWARD moves by the robot's step along its heading, or by less after a collision, without turning."""
        simulator = self.make_simulator(CAMERA)
        length = simulator.robot.forward_step
        outcomes = set()
        for start in starts(simulator, 8):
            simulator.reset(*start)
            for _ in range(60):
                before = simulator.pose
                collided = simulator.step(Action.FORWARD)
                after = simulator.pose
                _check_rigid_and_level(after)
                moved = (after[:3, 3] - before[:3, 3])[[0, 2]]
                ahead = length * before[[0, 2], 2]
                if collided:
                    assert np.linalg.norm(moved) < length, "it collided but moved the whole distance"
                else:
                    np.testing.assert_allclose(moved, ahead, atol=self.position_tolerance)
                assert _turned(yaw_of(before), yaw_of(after)) == pytest.approx(0.0, abs=1e-3)
                outcomes.add(collided)
                if collided:
                    break
        assert outcomes == {True, False}, "in eight walks ahead it never collided, or never moved freely"

    def test_never_leaves_the_free_floor(self) -> None:
        """A walk of random actions stays in the free space, with a tolerance of one cell."""
        simulator = self.placed()
        space = simulator.free_space()
        near = ndimage.binary_dilation(space.free, np.ones((3, 3)))
        for action in np.random.default_rng(1).choice([0, 0, 0, 1, 2], size=150):
            simulator.step(Action(action))
            x, z = simulator.pose[[0, 2], 3]
            assert _is_at(space, near, x, z), f"the robot is at x={x:.2f}, z={z:.2f}, off the free floor"

    def test_frames_hold_what_is_asked_for(self) -> None:
        """Frames contain the requested channels with their types; depth and colours do not depend on the channels."""
        simulator = self.placed()
        shape = (CAMERA.height, CAMERA.width)
        whole = simulator.observe(EVERYTHING)
        for chosen in chain.from_iterable(combinations(Channel, count) for count in range(4)):
            frame = simulator.observe(frozenset(chosen))
            assert (frame.depth.shape, frame.depth.dtype) == (shape, np.float32)
            assert (frame.pose.shape, frame.pose.dtype) == ((4, 4), np.float64)
            np.testing.assert_array_equal(frame.pose, simulator.pose)
            np.testing.assert_array_equal(frame.depth, whole.depth, "the depth depends on the channels")
            assert frame.rgb.dtype == np.uint8
            assert frame.rgb.shape == ((*shape, 3) if Channel.COLOR in chosen else (0, 0, 3))
            if Channel.COLOR in chosen:
                np.testing.assert_array_equal(frame.rgb, whole.rgb, "the colours depend on the channels")
            for channel, values in ((Channel.LABELS, frame.labels), (Channel.OBJECTS, frame.objects)):
                assert (values is not None) == (channel in chosen), f"{channel} with {set(chosen)}"
                if values is not None:
                    assert (values.shape, values.dtype) == (shape, np.int32)

    def test_depth_is_in_range_or_zero(self) -> None:
        """Depth outside the camera's range is 0, and the range changes no other pixel."""
        narrow = Camera(CAMERA.width, CAMERA.height, min_depth=1.0, max_depth=2.5)
        limited, open_ended = self.placed(narrow), self.placed(Camera(CAMERA.width, CAMERA.height, max_depth=1e3))
        poses = _poses(limited, 6)
        for seen, everything in zip(limited.observe(DEPTH, poses), open_ended.observe(DEPTH, poses), strict=True):
            inside = (everything.depth >= narrow.min_depth) & (everything.depth <= narrow.max_depth)
            np.testing.assert_allclose(seen.depth, np.where(inside, everything.depth, 0.0), atol=1e-3)
            assert (everything.depth > 0.0).any(), "the camera sees no surface at all"

    def test_labels_and_objects_have_names(self) -> None:
        """Labels and objects are valid indices or -1, and the pixels of an object have its label and a depth."""
        simulator = self.placed()
        names, object_labels = simulator.label_names, simulator.object_labels
        assert set(object_labels) <= set(names), "an object's label is not among the labels"
        for frame in simulator.observe(EVERYTHING, _poses(simulator, 6)):
            assert frame.labels is not None
            assert frame.objects is not None
            assert frame.labels.min() >= -1
            assert frame.labels.max() < len(names)
            assert frame.objects.min() >= -1
            assert frame.objects.max() < len(object_labels)
            for number in np.unique(frame.objects[frame.objects >= 0]):
                there = frame.objects == number
                labels = {names[label] for label in np.unique(frame.labels[there])}
                assert labels == {object_labels[number]}, f"object {number} is labelled {labels}"
                assert (frame.depth[there] > 0.0).all(), f"object {number} is out of the camera's range"

    def test_a_batch_is_its_single_frames(self) -> None:
        """Frames of a batch equal single frames bitwise, and rendering does not move the robot."""
        simulator = self.make_simulator(CAMERA)
        simulator.reset(*starts(simulator, 6)[-1])
        poses = np.concatenate([_poses(simulator, 5), simulator.pose[None]])
        batch = simulator.observe(EVERYTHING, poses)
        np.testing.assert_array_equal(simulator.pose, poses[-1], "drawing a batch moved the robot")
        assert len(batch) == len(poses)
        for frame, pose in zip(batch, poses, strict=True):
            np.testing.assert_array_equal(frame.pose, pose)
            assert_same(frame, simulator.observe(EVERYTHING, pose[None])[0])
        assert_same(batch[-1], simulator.observe(EVERYTHING))
        assert simulator.observe(EVERYTHING, poses[:0]) == []

    def test_depth_agrees_between_views(self) -> None:
        """Points of one view, reprojected to another one by depth, poses and intrinsics, agree with its depth."""
        simulator = self.make_simulator(CAMERA)
        errors = []
        for start in starts(simulator, 6):
            simulator.reset(*start)
            before = simulator.observe(DEPTH)
            simulator.step(Action.LEFT)
            simulator.step(Action.FORWARD)
            errors.append(_depth_errors(simulator.observe(DEPTH), before, CAMERA))
        error = np.concatenate(errors)
        assert len(error) > 100, "the views have next to nothing in common"
        assert np.median(error) < 0.01, f"the depths of two views differ by {np.median(error):.1%} in the median"
        assert (error < 0.05).mean() > 0.8, "the depths of two views differ in more than a fifth of the pixels"

    def test_what_it_returns_is_the_callers(self) -> None:
        """Writing to a returned frame or pose changes neither the robot nor later frames."""
        simulator = self.placed()
        pose = simulator.pose
        before = pose.copy()
        pose[:] = 0.0
        np.testing.assert_array_equal(simulator.pose, before, "writing into the pose moved the robot")
        first, again = (simulator.observe(EVERYTHING) for _ in range(2))
        for values in (again.rgb, again.depth, again.pose, again.labels, again.objects):
            assert values is not None
            values[:] = 0
        assert_same(simulator.observe(EVERYTHING), first)

    def test_another_robot_is_independent(self) -> None:
        """`another` has a separate pose and optionally another camera in the same scene, and renders equal frames."""
        simulator = self.placed()
        first, second = starts(simulator, 2)
        seen = simulator.observe(EVERYTHING)
        other, wide = simulator.another(), simulator.another(Camera(30, 20, hfov=110.0))
        assert (other.camera, wide.camera) == (CAMERA, Camera(30, 20, hfov=110.0))
        assert other.scene == simulator.scene
        assert other.floors == wide.floors == simulator.floors
        for robot in (other, wide):
            robot.reset(*second)
            robot.step(Action.LEFT)
            assert_same(simulator.observe(EVERYTHING), seen)
        assert wide.observe(COLOR).rgb.shape == (20, 30, 3)
        other.reset(*first)
        assert_same(other.observe(EVERYTHING), seen)
        simulator.step(Action.LEFT)
        assert_same(other.observe(EVERYTHING), seen)


def _poses(simulator: Simulator, count: int) -> np.ndarray:
    """Camera poses on the main floor, N x 4 x 4; does not move the robot of `simulator`."""
    robot = simulator.another()
    poses = []
    for start in starts(robot, count):
        robot.reset(*start)
        poses.append(robot.pose)
    return np.stack(poses)


def _check_rigid_and_level(pose: np.ndarray) -> None:
    assert (pose.shape, pose.dtype) == ((4, 4), np.float64)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6, err_msg="the pose is not rigid")
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_array_equal(pose[3], [0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(pose[:3, 1], [0.0, -1.0, 0.0], atol=1e-6, err_msg="the camera is not level")


def _turned(before: float, after: float) -> float:
    """Angle from one heading to another in radians, in [-pi, pi)."""
    return (after - before + math.pi) % (2.0 * math.pi) - math.pi


def _is_at(space: FreeSpace, cells: np.ndarray, x: float, z: float) -> bool:
    rows, columns = space.frame.cells(x, z)
    return bool(space.frame.contains(rows, columns) and cells[rows, columns])


def _depth_errors(source: Frame, target: Frame, camera: Camera) -> np.ndarray:
    """Relative depth errors of the target's pixels in the source view, where the source depth is locally smooth."""
    points = (camera.rays() * target.depth[..., None])[target.depth > 0.0]
    source_from_target = inverse(source.pose) @ target.pose
    points = points @ source_from_target[:3, :3].T + source_from_target[:3, 3]
    points = points[points[:, 2] > camera.min_depth]
    u, v = np.rint((points @ camera.intrinsics.T)[:, :2] / points[:, 2:]).astype(np.int64).T
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    u, v, expected = u[inside], v[inside], points[inside, 2]
    highest = ndimage.maximum_filter(source.depth, 3, mode="nearest")[v, u]
    lowest = ndimage.minimum_filter(source.depth, 3, mode="nearest")[v, u]
    smooth = (lowest > 0.0) & (highest < 1.05 * lowest) & (expected <= camera.max_depth)
    return np.abs(source.depth[v, u] / expected - 1.0)[smooth]
