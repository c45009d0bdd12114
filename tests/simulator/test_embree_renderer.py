from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deux.contracts import Material, Scene
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.simulator.embree_renderer import EmbreeRenderer


def poses_in(scene: Scene) -> list[np.ndarray]:
    """Camera poses inside a box, turned every way."""
    rng = np.random.default_rng(1)
    low, high = scene.mesh.bounds
    poses = [camera_pose(1.0, 1.25, 2.0, 0.3)]
    for rotation in Rotation.random(5, rng=rng):
        pose = np.eye(4)
        pose[:3, :3] = rotation.as_matrix()
        pose[:3, 3] = rng.uniform(low + 0.3, high - 0.3)
        poses.append(pose)
    return poses


def box_depth(scene: Scene, camera: Camera, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth to, and number of, the side of the box that the ray through each pixel's centre meets."""
    f = camera.width / 2 / np.tan(np.radians(camera.hfov) / 2)
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(u - camera.width / 2) / f, (v - camera.height / 2) / f, np.ones_like(u)], -1)
    rays = rays @ pose[:3, :3].T
    low, high = scene.mesh.bounds.astype(np.float64)
    with np.errstate(divide="ignore"):
        reach = (np.where(rays > 0, high, low) - pose[:3, 3]) / rays
    axis = reach.argmin(-1)
    toward_high = np.take_along_axis(rays > 0, axis[..., None], -1)[..., 0]
    return reach.min(-1), 2 * axis + toward_high


@pytest.mark.parametrize("camera", [Camera(64, 48, 70.0), Camera(33, 40, 90.0)])
def test_a_box_is_seen_at_its_analytic_depth(box: Scene, camera: Camera) -> None:
    renderer = EmbreeRenderer(box, camera)
    for pose in poses_in(box):
        image = renderer.render(pose)
        depth, side = box_depth(box, camera, pose)
        assert image.depth.dtype == np.float32
        np.testing.assert_allclose(image.depth, depth, atol=1e-5)
        # Where two sides meet, either may be seen.
        assert (image.labels == side).mean() > 0.998
        seen = np.array([material.color for material in box.mesh.materials])[image.labels]
        np.testing.assert_array_equal(image.rgb, seen)


def test_the_cameras_intrinsics_put_pixels_back_on_the_walls(box: Scene) -> None:
    camera = Camera(64, 48, 80.0)
    renderer = EmbreeRenderer(box, camera)
    k = camera.intrinsics
    v, u = np.mgrid[: camera.height, : camera.width]
    for pose in poses_in(box):
        depth = renderer.render(pose).depth
        points = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(depth)]) * depth
        world = (pose[:3, :3] @ points.reshape(3, -1)).T + pose[:3, 3]
        to_walls = np.abs(world[:, None] - box.mesh.bounds).min(axis=(1, 2))
        assert to_walls.max() < 1e-5


def test_depth_out_of_range_is_none_but_still_has_colour(box: Scene) -> None:
    pose = camera_pose(2.0, 1.0, 1.5, 0.0)
    everything = EmbreeRenderer(box, Camera(32, 32, min_depth=0.0)).render(pose)
    limited = EmbreeRenderer(box, Camera(32, 32, min_depth=1.2, max_depth=1.499)).render(pose)
    in_range = (everything.depth >= 1.2) & (everything.depth <= 1.499)
    assert 0.05 < in_range.mean() < 0.95
    assert (everything.depth < 1.2).any()
    assert (everything.depth > 1.499).any()
    np.testing.assert_array_equal(limited.depth, np.where(in_range, everything.depth, 0.0))
    np.testing.assert_array_equal(limited.rgb, everything.rgb)


def test_where_there_is_nothing_all_is_empty(make_quads: Callable[..., Scene]) -> None:
    wall = np.array([[[-1, -1, -2], [0, -1, -2], [0, 1, -2], [-1, 1, -2]]], dtype=float)
    scene = make_quads(wall, (Material("white"),))
    image = EmbreeRenderer(scene, Camera(40, 40)).render(camera_pose(0, 0, 0, 0))
    left = np.zeros((40, 40), dtype=bool)
    left[10:30, 10:20] = True
    np.testing.assert_array_equal(image.depth, np.where(left, np.float32(2.0), 0.0))
    np.testing.assert_array_equal(image.labels, np.where(left, 0, -1))
    np.testing.assert_array_equal(image.rgb, np.where(left, 255, 0)[..., None].repeat(3, -1))
    behind = EmbreeRenderer(scene, Camera(40, 40)).render(camera_pose(0, 0, -4, np.pi), labels=False)
    assert behind.labels is None
    assert (behind.depth > 0).any()  # a face is seen from its back too


def test_small_house_looks_as_in_habitat(small_house: Scene, habitat_views: list) -> None:
    renderer = EmbreeRenderer(small_house, Camera(400, 400, 90.0, min_depth=0.0, max_depth=1000.0))
    for view in habitat_views:
        image = renderer.render(view.pose, labels=False)
        hit = image.depth > 0
        assert (hit == (view.depth > 0)).mean() >= 0.999
        assert np.percentile(np.abs(image.depth - view.depth)[hit], 95) <= 3e-4
        color_difference = np.abs(image.rgb.astype(int) - view.rgb)
        assert color_difference.mean() < 1.0  # grey levels; measured: 0.01 to 0.56
        assert np.percentile(color_difference, 99) <= 10


def test_faces_are_those_that_the_labels_belong_to(box: Scene) -> None:
    camera = Camera(40, 30, max_depth=2.5)
    renderer = EmbreeRenderer(box, camera)
    pose = camera_pose(1.0, 1.2, 2.7, 0.4)
    depth, face = renderer.faces(pose)
    image = renderer.render(pose)
    np.testing.assert_array_equal(depth, image.depth)
    assert (depth == 0.0).any()  # the far wall is out of range
    np.testing.assert_array_equal(face, np.where(depth > 0.0, face, -1))
    np.testing.assert_array_equal(face[depth > 0.0] // 2, image.labels[depth > 0.0])  # side i is faces 2i and 2i + 1


def test_depth_alone_is_that_of_the_image_and_needs_no_textures(
    box: Scene, flat: Scene, flat_poses: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deux.simulator.embree_renderer.prepare_surfaces", lambda mesh: pytest.fail("shading"))
    alone = [
        [(renderer, pose, renderer.depth(pose), renderer.labelled_depth(pose)) for pose in poses]
        for renderer, poses in (
            (EmbreeRenderer(box, Camera(33, 40, 90.0, min_depth=1.2, max_depth=2.0)), poses_in(box)),
            (EmbreeRenderer(flat, Camera(48, 32)), flat_poses),
        )
    ]
    monkeypatch.undo()
    for renderer, pose, depth, labelled in (part for parts in alone for part in parts):
        assert depth.dtype == np.float32
        image = renderer.render(pose)
        np.testing.assert_array_equal(depth, image.depth)
        np.testing.assert_array_equal(labelled[0], image.depth)
        np.testing.assert_array_equal(labelled[1], image.labels)
        assert (depth > 0).any()
