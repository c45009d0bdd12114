from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deux.contracts import Material, Scene
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.scenes.ray_caster import RayCaster
from deux.simulator.embree_renderer import EmbreeRenderer
from deux.simulator.renderers import RenderedImage


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


def render(renderer: EmbreeRenderer, pose: np.ndarray) -> RenderedImage:
    """All that can be asked of one pose."""
    return renderer.render(pose[None], colors=True, faces=True)[0]


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
    renderer = EmbreeRenderer(box.mesh, camera)
    for pose in poses_in(box):
        image = render(renderer, pose)
        depth, side = box_depth(box, camera, pose)
        assert image.depth.dtype == np.float32
        np.testing.assert_allclose(image.depth, depth, atol=1e-5)
        # Where two sides meet, either may be seen. Side i is faces 2 i and 2 i + 1.
        assert (image.face // 2 == side).mean() > 0.998
        seen = np.array([material.color for material in box.mesh.materials])[image.face // 2]
        np.testing.assert_array_equal(image.rgb, seen)


def test_the_cameras_intrinsics_put_pixels_back_on_the_walls(box: Scene) -> None:
    camera = Camera(64, 48, 80.0)
    renderer = EmbreeRenderer(box.mesh, camera)
    k = camera.intrinsics
    v, u = np.mgrid[: camera.height, : camera.width]
    for pose in poses_in(box):
        depth = render(renderer, pose).depth
        points = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(depth)]) * depth
        world = (pose[:3, :3] @ points.reshape(3, -1)).T + pose[:3, 3]
        to_walls = np.abs(world[:, None] - box.mesh.bounds).min(axis=(1, 2))
        assert to_walls.max() < 1e-5


def test_depth_out_of_range_is_none_but_still_has_colour(box: Scene) -> None:
    pose = camera_pose(2.0, 1.0, 1.5, 0.0)
    everything = render(EmbreeRenderer(box.mesh, Camera(32, 32, min_depth=0.0)), pose)
    limited = render(EmbreeRenderer(box.mesh, Camera(32, 32, min_depth=1.2, max_depth=1.499)), pose)
    in_range = (everything.depth >= 1.2) & (everything.depth <= 1.499)
    assert 0.05 < in_range.mean() < 0.95
    assert (everything.depth < 1.2).any()
    assert (everything.depth > 1.499).any()
    np.testing.assert_array_equal(limited.depth, np.where(in_range, everything.depth, 0.0))
    np.testing.assert_array_equal(limited.rgb, everything.rgb)
    np.testing.assert_array_equal(limited.face, everything.face)


def test_where_there_is_nothing_all_is_empty(make_quads: Callable[..., Scene]) -> None:
    wall = np.array([[[-1, -1, -2], [0, -1, -2], [0, 1, -2], [-1, 1, -2]]], dtype=float)
    scene = make_quads(wall, (Material("white"),))
    renderer = EmbreeRenderer(scene.mesh, Camera(40, 40))
    image = render(renderer, camera_pose(0, 0, 0, 0))
    left = np.zeros((40, 40), dtype=bool)
    left[10:30, 10:20] = True
    np.testing.assert_allclose(image.depth, np.where(left, 2.0, 0.0), rtol=1e-6)
    np.testing.assert_array_equal(image.face >= 0, left)
    np.testing.assert_array_equal(image.rgb, np.where(left, 255, 0)[..., None].repeat(3, -1))
    behind = render(renderer, camera_pose(0, 0, -4, np.pi))
    assert (behind.depth > 0).any()  # a face is seen from its back too


def test_only_what_is_asked_for_is_drawn(
    box: Scene, flat: Scene, flat_poses: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    cases = [
        (EmbreeRenderer(box.mesh, Camera(33, 40, 90.0, min_depth=1.2, max_depth=2.0)), np.stack(poses_in(box))),
        (EmbreeRenderer(flat.mesh, Camera(48, 32)), np.stack(flat_poses)),
    ]
    monkeypatch.setattr("deux.simulator.embree_renderer.prepare_surfaces", lambda mesh: pytest.fail("shading"))
    without_colors = [renderer.render(poses, colors=False, faces=True) for renderer, poses in cases]
    monkeypatch.undo()
    for (renderer, poses), bare in zip(cases, without_colors, strict=True):
        for pose, alone in zip(poses, bare, strict=True):
            image = render(renderer, pose)
            assert alone.rgb is None
            assert alone.depth.dtype == np.float32
            assert alone.face is not None
            assert alone.face.dtype == np.int32
            np.testing.assert_array_equal(alone.depth, image.depth)
            np.testing.assert_array_equal(alone.face, image.face)
            assert (alone.depth > 0).any()
        assert all(image.face is None for image in renderer.render(poses))


def test_a_batch_is_its_single_images(flat: Scene, flat_poses: list[np.ndarray]) -> None:
    renderer = EmbreeRenderer(flat.mesh, Camera(48, 32))
    batch = renderer.render(np.stack(flat_poses), colors=True, faces=True)
    for pose, image in zip(flat_poses, batch, strict=True):
        for one, other in zip(image, render(renderer, pose), strict=True):
            np.testing.assert_array_equal(one, other)
    assert renderer.render(np.zeros((0, 4, 4))) == []


def test_cameras_of_one_mesh_share_what_is_prepared(
    flat: Scene, flat_poses: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    caster = RayCaster(flat.mesh)
    first = EmbreeRenderer(flat.mesh, Camera(48, 32), caster)
    second = first.another(Camera(20, 30, 60.0))
    expected = render(EmbreeRenderer(flat.mesh, Camera(20, 30, 60.0)), flat_poses[0])
    render(first, flat_poses[0])
    monkeypatch.setattr("deux.simulator.embree_renderer.prepare_surfaces", lambda mesh: pytest.fail("not shared"))
    monkeypatch.setattr("deux.scenes.ray_caster.TriangleMesh", lambda *mesh: pytest.fail("not shared"))
    for one, other in zip(render(second, flat_poses[0]), expected, strict=True):
        np.testing.assert_array_equal(one, other)
    assert first.camera == Camera(48, 32)
