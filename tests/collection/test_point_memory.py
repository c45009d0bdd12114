import numpy as np
import pytest

from deux.collection.point_memory import PointMemory
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose

CAMERA = Camera(48, 40, 90.0)
WALL = 3.0
BOX = 1.5


def at(x: float, z: float = 0.0) -> np.ndarray:
    return camera_pose(x, 1.0, z, 0.0)


def wall_depth(pose: np.ndarray, box: bool = False) -> np.ndarray:
    """A wall across the view at z = -WALL; with a box, a nearer surface at x > 0 and z = -BOX."""
    depth = np.full((CAMERA.height, CAMERA.width), WALL + pose[2, 3], np.float32)
    if box:
        near = BOX + pose[2, 3]
        columns = np.arange(CAMERA.width)
        x = pose[0, 3] + (columns - CAMERA.intrinsics[0, 2]) / CAMERA.focal_length * near
        depth[:, x > 0.0] = near
    return depth


def points_of(depth: np.ndarray, seed: int, count: int = 20) -> np.ndarray:
    chosen = np.random.default_rng(seed).choice(depth.size, count, replace=False)
    sparse = np.zeros_like(depth)
    sparse.flat[chosen] = depth.flat[chosen]
    return sparse


def test_without_earlier_frames_it_is_the_frames_own_points():
    own = points_of(wall_depth(at(0.0), box=True), seed=0)
    for frames in (0, 5):
        np.testing.assert_array_equal(PointMemory(frames).add(own, at(0.0), CAMERA.intrinsics), own)


@pytest.mark.parametrize("move", [(0.4, 0.0), (0.0, -0.5), (-0.3, 0.25)])
def test_earlier_points_have_the_depth_that_they_have_from_the_new_pose(move):
    memory = PointMemory(5)
    memory.add(points_of(wall_depth(at(0.0)), seed=0), at(0.0), CAMERA.intrinsics)
    pose = at(*move)
    own = points_of(wall_depth(pose), seed=1)
    merged = memory.add(own, pose, CAMERA.intrinsics)
    known = merged > 0.0
    assert known.sum() > 1.4 * (own > 0.0).sum()
    np.testing.assert_allclose(merged[known], wall_depth(pose)[known], atol=1e-5)
    np.testing.assert_array_equal(merged[own > 0.0], own[own > 0.0])


def test_points_that_something_nearer_hides_are_left_out_and_the_frames_own_never():
    """From x = -1.2 the robot sees past the box's edge to the wall behind it; from x = 0.5 it does not."""
    memory, before, now = PointMemory(5), at(-1.2), at(0.5)
    memory.add(points_of(wall_depth(before, box=True), 0, count=200), before, CAMERA.intrinsics)
    truth = wall_depth(now, box=True)
    own = points_of(truth, 1, count=200)
    merged = memory.add(own, now, CAMERA.intrinsics)
    known = merged > 0.0
    wrong = known & (merged > truth + 0.1)
    assert wrong.sum() <= 0.02 * known.sum()
    everything = PointMemory(5)
    everything.add(points_of(wall_depth(before, box=True), 0, count=200), before, CAMERA.intrinsics)
    alone = everything.add(np.zeros_like(own), now, CAMERA.intrinsics)
    assert (alone > truth + 0.1).sum() > wrong.sum()  # so there are hidden points, and the new frame's points show it
    np.testing.assert_array_equal(merged[own > 0.0], own[own > 0.0])


def test_the_oldest_frames_are_forgotten():
    memory, nothing = PointMemory(2), np.zeros((CAMERA.height, CAMERA.width), np.float32)
    own = points_of(wall_depth(at(0.0)), seed=0)
    memory.add(own, at(0.0), CAMERA.intrinsics)
    counts = [np.count_nonzero(memory.add(nothing, at(0.0), CAMERA.intrinsics)) for _ in range(3)]
    assert counts == [20, 20, 0]


def test_points_behind_the_camera_and_outside_the_image_are_not_shown():
    memory, nothing = PointMemory(5), np.zeros((CAMERA.height, CAMERA.width), np.float32)
    memory.add(points_of(wall_depth(at(0.0)), seed=0), at(0.0), CAMERA.intrinsics)
    assert not memory.add(nothing, camera_pose(0.0, 1.0, 0.0, np.pi), CAMERA.intrinsics).any()
    assert not memory.add(nothing, at(20.0), CAMERA.intrinsics).any()
    assert not memory.add(nothing, at(0.0, -WALL - 1.0), CAMERA.intrinsics).any()
