import multiprocessing
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from opengl_suite import OpenGLRendererSuite, render

from deux.contracts import Material, Scene
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.simulator.embree_renderer import EmbreeRenderer
from deux.simulator.gl_context import GLContext
from deux.simulator.gl_renderer import GLRenderer


@pytest.fixture(scope="module", autouse=True)
def _opengl() -> None:
    try:
        GLContext()
    except DeuxError as error:
        pytest.skip(str(error))


def assert_agree(scene: Scene, poses: list[np.ndarray], color: float) -> None:
    """Both renderers see the same, and colours differ at edges alone, by at most `color` grey levels on average."""
    camera = Camera(256, 256)
    batches = [
        renderer(scene.mesh, camera).render(np.stack(poses), colors=True, faces=True)
        for renderer in (EmbreeRenderer, GLRenderer)
    ]
    for ours, theirs in zip(*batches, strict=True):
        difference = np.abs(ours.depth - theirs.depth)
        assert np.median(difference) <= 3e-6
        assert (difference > 0.01).mean() < 5e-4
        assert (ours.face != theirs.face).mean() < 1e-3  # of two faces that meet in a pixel, either
        off = np.abs(ours.rgb.astype(int) - theirs.rgb).max(axis=-1)
        assert off.mean() < color
        assert (off > 3).mean() < 2e-3


def test_agrees_with_embree_on_a_generated_flat(flat: Scene, flat_poses: list[np.ndarray]) -> None:
    assert_agree(flat, flat_poses, color=0.2)


def test_agrees_with_embree_on_small_house(small_house: Scene, habitat_views: list) -> None:
    assert_agree(small_house, [view.pose for view in habitat_views[:6]], color=0.2)


class TestGLRenderer(OpenGLRendererSuite):
    renderer = GLRenderer


def test_a_box_is_seen_at_its_analytic_depth(box: Scene) -> None:
    camera = Camera(65, 48, 80.0)
    heading = 0.3
    pose = camera_pose(1.0, 1.25, 2.0, heading)
    f = camera.width / 2 / np.tan(np.radians(camera.hfov) / 2)
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(u - camera.width / 2) / f, (v - camera.height / 2) / f, np.ones_like(u)], -1) @ pose[:3, :3].T
    low, high = box.mesh.bounds.astype(np.float64)
    reach = ((np.where(rays > 0, high, low) - pose[:3, 3]) / rays).min(axis=-1)
    np.testing.assert_allclose(render(GLRenderer(box.mesh, camera), pose).depth, reach, atol=1e-4)
    assert np.median(np.abs(render(GLRenderer(box.mesh, camera), pose).depth - reach)) < 1e-6


def test_where_there_is_nothing_all_is_empty(make_quads: Callable[..., Scene]) -> None:
    wall = np.array([[[-1, -1, -2], [0, -1, -2], [0, 1, -2], [-1, 1, -2]]], dtype=float)
    renderer = GLRenderer(make_quads(wall, (Material("white"),)).mesh, Camera(40, 40))
    image = render(renderer, camera_pose(0, 0, 0, 0))
    left = np.zeros((40, 40), dtype=bool)
    left[10:30, 10:20] = True
    np.testing.assert_allclose(image.depth, np.where(left, 2.0, 0.0), atol=1e-6)
    np.testing.assert_array_equal(image.face >= 0, left)
    np.testing.assert_array_equal(image.rgb, np.where(left, 255, 0)[..., None].repeat(3, -1))
    away = render(renderer, camera_pose(0, 0, 0, np.pi))
    assert not away.depth.any()
    assert (away.face == -1).all()
    assert renderer.render(np.zeros((0, 4, 4))) == []


def test_depth_out_of_range_is_none_but_still_has_colour(box: Scene) -> None:
    pose = camera_pose(2.0, 1.0, 1.5, 0.0)
    everything = render(GLRenderer(box.mesh, Camera(32, 32, min_depth=0.0)), pose)
    limited = render(GLRenderer(box.mesh, Camera(32, 32, min_depth=1.2, max_depth=1.499)), pose)
    in_range = (everything.depth >= 1.2) & (everything.depth <= 1.499)
    assert 0.05 < in_range.mean() < 0.95
    np.testing.assert_array_equal(limited.depth, np.where(in_range, everything.depth, 0.0))
    np.testing.assert_array_equal(limited.rgb, everything.rgb)
    np.testing.assert_array_equal(limited.face, everything.face)


def test_far_textures_are_blurred_as_the_rays_shader_blurs_them(make_quads: Callable[..., Scene]) -> None:
    """On a floor of fine checks, each pixel far away is grey; sizes are odd, and neither texture is square."""
    floor = np.array([[[-40, -1, 40], [40, -1, 40], [40, -1, -40], [-40, -1, -40]]], dtype=float)
    checks = (np.indices((250, 331)).sum(axis=0) % 2 * 255).astype(np.uint8)
    scene = make_quads(floor, (Material("checks", (255, 255, 255), np.repeat(checks[..., None], 3, axis=-1)),))
    camera = Camera(96, 96, max_depth=100.0)
    ours, theirs = (
        render(kind(scene.mesh, camera), camera_pose(0, 0, 0, 0.2)) for kind in (EmbreeRenderer, GLRenderer)
    )
    far = (theirs.depth > 15.0) & (theirs.depth < 35.0)
    assert far.sum() > 100
    assert np.abs(theirs.rgb[far].astype(int) - 127).max() <= 3
    assert np.abs(ours.rgb.astype(int) - theirs.rgb).mean() < 1.0


def test_batches_larger_than_what_is_drawn_at_once(box: Scene) -> None:
    renderer = GLRenderer(box.mesh, Camera(24, 24))
    poses = np.stack([camera_pose(2.0, 1.2, 1.5, heading) for heading in np.linspace(0, 6, 35)])
    for pose, image in zip(poses, renderer.render(poses), strict=True):
        np.testing.assert_array_equal(image.rgb, renderer.render(pose[None])[0].rgb)


def test_what_hides_in_another_room_is_not_missed(flat: Scene, flat_poses: list[np.ndarray]) -> None:
    """Occluded clusters are left out on the CPU; the image is the same as with all of them."""
    renderer = GLRenderer(flat.mesh, Camera(200, 150))
    culled = renderer.render(np.stack(flat_poses), colors=True, faces=True)
    renderer._model.scene.context.on_cpu = False
    whole = renderer.render(np.stack(flat_poses), colors=True, faces=True)
    for one, other in zip(culled, whole, strict=True):
        np.testing.assert_allclose(one.depth, other.depth, atol=1e-6)
        assert (one.face != other.face).mean() < 1e-4  # where two surfaces coincide, the one drawn first is seen
        assert (one.rgb != other.rgb).mean() < 1e-4


def test_any_thread_may_draw(box: Scene) -> None:
    renderer = GLRenderer(box.mesh, Camera(16, 16))
    pose = camera_pose(2.0, 1.0, 1.5, 0.4)
    here = render(renderer, pose)
    with ThreadPoolExecutor(1) as pool:
        there = pool.submit(render, renderer, pose).result()
    np.testing.assert_array_equal(here.rgb, there.rgb)


def test_a_copy_in_a_spawned_process_draws_the_same(box: Scene) -> None:
    renderer = GLRenderer(box.mesh, Camera(16, 16))
    pose = camera_pose(2.0, 1.0, 1.5, 0.4)
    here = render(renderer, pose)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        there = pool.submit(GLRenderer.render, renderer, pose[None], True, True).result()[0]
    for one, other in zip(here, there, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_model_can_be_trained_after_something_was_drawn() -> None:
    """Mesa and torch's compiler each bring an LLVM: in the wrong order the process crashes."""
    program = (
        "from deux.simulator.gl_context import GLContext\n"
        "context = GLContext()\n"
        "import torch\n"
        "torch.optim.Adam(torch.nn.Linear(2, 2).parameters())"
    )
    subprocess.run([sys.executable, "-c", program], timeout=120, check=True)
