import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deux.geometry.poses import absorb_intrinsics, camera_pose, inverse, motion, source_from_target, yaw_of


def test_camera_looks_along_minus_z_with_y_down():
    pose = camera_pose(1.0, 1.25, 2.0, yaw=0.0)
    np.testing.assert_allclose(pose @ [0.0, 0.0, 3.0, 1.0], [1.0, 1.25, -1.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(pose @ [0.0, 1.0, 0.0, 1.0], [1.0, 0.25, 2.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(pose @ [1.0, 0.0, 0.0, 1.0], [2.0, 1.25, 2.0, 1.0], atol=1e-12)


def test_positive_yaw_turns_left():
    ahead = camera_pose(0.0, 0.0, 0.0, yaw=math.pi / 2)[:3, 2]
    np.testing.assert_allclose(ahead, [-1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("yaw", [-3.0, -0.5, 0.0, 1.2, 3.1])
def test_pose_is_a_rotation_and_gives_its_yaw_back(yaw):
    pose = camera_pose(0.3, 1.0, -2.0, yaw)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert yaw_of(pose) == pytest.approx(yaw)


def test_inverse_agrees_with_the_general_one():
    pose = np.stack([camera_pose(1.0, 2.0, 3.0, 0.4), camera_pose(-1.0, 0.0, 5.0, -2.0)])
    np.testing.assert_allclose(inverse(pose), np.linalg.inv(pose), atol=1e-12)


def test_source_from_target_carries_camera_points():
    target, source = camera_pose(0.0, 1.0, 0.0, 0.1), camera_pose(0.2, 1.0, -0.3, -0.4)
    point = np.array([0.3, -0.2, 2.0, 1.0])
    np.testing.assert_allclose(source @ (source_from_target(target, source) @ point), target @ point, atol=1e-12)


def test_the_targets_matrix_projects_into_another_camera():
    own = np.array([[120.0, 0.3, 60.0], [0.0, 118.0, 44.0], [0.0, 0.0, 1.0]])
    other = np.array([[131.0, -0.8, 66.0], [0.0, 127.0, 41.0], [0.0, 0.0, 1.0]])
    relative = source_from_target(camera_pose(0.0, 1.0, 0.0, 0.1), camera_pose(0.2, 1.1, -0.3, -0.4))
    points = np.random.default_rng(0).uniform([-1, -1, 1, 1], [1, 1, 4, 1], (9, 4)).T
    seen = other @ (relative @ points)[:3]
    projected = own @ (absorb_intrinsics(relative, own, other) @ points)[:3]
    np.testing.assert_allclose(projected[:2] / projected[2], seen[:2] / seen[2], rtol=1e-12)
    np.testing.assert_allclose(projected[2], (relative @ points)[2], rtol=1e-12)  # the distance is the source's
    assert absorb_intrinsics(relative, own, own.copy()) is relative


def test_motion_is_distance_and_angle():
    target = camera_pose(0.0, 1.0, 0.0, 0.2)
    source = target @ np.block(
        [
            [
                Rotation.from_rotvec([0.0, math.radians(25.0), 0.0]).as_matrix(),
                np.array([[0.3], [0.0], [0.4]]),
            ],
            [np.array([[0.0, 0.0, 0.0, 1.0]])],
        ]
    )
    assert motion(target, source) == pytest.approx((0.5, 25.0))
    assert motion(target, target) == pytest.approx((0.0, 0.0), abs=1e-5)
