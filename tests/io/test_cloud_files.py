"""Clouds as files, read back by trimesh and from the bytes."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from deux.geometry.point_cloud import PointCloud
from deux.io.cloud_files import write_cloud


@pytest.fixture
def cloud() -> PointCloud:
    rng = np.random.default_rng(0)
    return PointCloud(rng.uniform(-3, 3, (200, 3)).astype(np.float32), rng.integers(0, 256, (200, 3), np.uint8))


def test_ply_is_binary_with_colours(tmp_path: Path, cloud: PointCloud) -> None:
    write_cloud(tmp_path / "new" / "a.ply", cloud, camera_axes=True)
    header, _, body = (tmp_path / "new" / "a.ply").read_bytes().partition(b"end_header\n")
    assert b"format binary_little_endian 1.0" in header
    assert len(body) == 200 * (3 * 4 + 4)
    vertices = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4)]))
    np.testing.assert_array_equal(vertices["xyz"], cloud.points)
    np.testing.assert_array_equal(vertices["rgba"][:, :3], cloud.colors)


@pytest.mark.parametrize("camera_axes", [False, True])
def test_glb_is_upright(tmp_path: Path, cloud: PointCloud, camera_axes: bool) -> None:
    """glTF takes y for up; a camera's y points down."""
    write_cloud(tmp_path / "a.glb", cloud, camera_axes)
    scene = trimesh.load_scene(tmp_path / "a.glb")
    (points,) = scene.dump()
    expected = cloud.points * ([1, -1, -1] if camera_axes else [1, 1, 1])
    np.testing.assert_allclose(points.vertices, expected, atol=1e-6)
    np.testing.assert_array_equal(points.colors[:, :3], cloud.colors)
