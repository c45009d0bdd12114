"""Points of depth maps against the camera's own rays, and voxels against a dictionary."""

import numpy as np
import pytest

from deux.geometry import point_cloud
from deux.geometry.camera import Camera
from deux.geometry.point_cloud import VoxelFusion, unproject
from deux.testing.box_world import Box, BoxWorld


def test_points_lie_on_the_surfaces_that_were_seen() -> None:
    """Every point of an exact depth image is on a wall, the floor, the ceiling or a side of the box."""
    world = BoxWorld(4.0, 5.0, (Box(0.5, 0.5, 1.0, 1.2, 0.8),), Camera(40, 30))
    world.reset(2.0, 4.0, 0.2)
    frame = world.observe()
    points = unproject(frame.depth, world.camera.intrinsics, frame.pose)[frame.depth > 0]
    planes = [
        (0, 0.0),
        (0, 4.0),
        (1, 0.0),
        (1, 2.5),
        (2, 0.0),
        (2, 5.0),
        (0, 0.5),
        (0, 1.0),
        (1, 0.8),
        (2, 0.5),
        (2, 1.2),
    ]
    distance = np.min([np.abs(points[:, axis] - place) for axis, place in planes], axis=0)
    assert len(points) == 40 * 30
    assert distance.max() < 1e-4
    np.testing.assert_allclose(
        unproject(frame.depth, world.camera.intrinsics), world.camera.rays() * frame.depth[..., None], atol=1e-6
    )


@pytest.mark.parametrize("most_pending", [10, 10_000])
def test_a_voxel_holds_the_mean_of_its_points(monkeypatch: pytest.MonkeyPatch, most_pending: int) -> None:
    monkeypatch.setattr(point_cloud, "_MOST_PENDING", most_pending)
    rng = np.random.default_rng(0)
    points, colors = rng.uniform(-1, 1, (500, 3)), rng.integers(0, 256, (500, 3), np.uint8)
    fusion, expected = VoxelFusion(0.25), {}
    for part in np.split(np.arange(500), [7, 8, 8, 300]):
        fusion.add(points[part], colors[part])
    for point, color in zip(points, colors, strict=True):
        expected.setdefault(tuple(np.floor(point / 0.25)), []).append((*point, *color))
    cloud = fusion.cloud()
    means = np.array([np.mean(members, axis=0) for _, members in sorted(expected.items())])
    assert cloud.points.dtype == np.float32
    np.testing.assert_allclose(cloud.points, means[:, :3], atol=1e-6)
    np.testing.assert_allclose(cloud.colors.astype(float), means[:, 3:], atol=0.5001)
    np.testing.assert_array_equal(fusion.cloud().points, cloud.points)


def test_without_voxels_all_points_are_kept() -> None:
    fusion = VoxelFusion(0.0)
    assert fusion.cloud().points.shape == (0, 3)
    for _ in range(2):
        fusion.add(np.array([[1.0, 2.0, 3.0]]), np.array([[4, 5, 6]], np.uint8))
    assert fusion.cloud().points.tolist() == [[1.0, 2.0, 3.0]] * 2
    assert fusion.cloud().colors.tolist() == [[4, 5, 6]] * 2


def test_points_beyond_all_voxels_are_left_out() -> None:
    fusion = VoxelFusion(0.001)
    fusion.add(np.array([[1e6, 0.0, 0.0]]), np.zeros((1, 3), np.uint8))
    assert len(fusion.cloud().points) == 0
    fusion.add(np.array([[0.5, 0.0, 0.0]]), np.zeros((1, 3), np.uint8))
    assert len(fusion.cloud().points) == 1
