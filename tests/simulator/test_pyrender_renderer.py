import os
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

from deux.contracts import Material, Scene
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.simulator.egl_context import EGLContext
from deux.simulator.embree_renderer import EmbreeRenderer
from deux.simulator.pyrender_renderer import PyrenderRenderer
from deux.simulator.renderers import RenderedImage, Renderer


@pytest.fixture(scope="module", autouse=True)
def _opengl() -> None:
    try:
        EGLContext(8, 8)
    except DeuxError as error:
        pytest.skip(str(error))


def render(renderer: Renderer, pose: np.ndarray) -> RenderedImage:
    """All that can be asked of one pose."""
    return renderer.render(pose[None], colors=True, faces=True)[0]


def assert_agree(scene: Scene, poses: list[np.ndarray], color: float) -> None:
    """Both renderers see the same, and colours differ by at most `color` grey levels on average."""
    camera = Camera(256, 256)
    batches = [
        renderer(scene.mesh, camera).render(np.stack(poses), colors=True, faces=True)
        for renderer in (EmbreeRenderer, PyrenderRenderer)
    ]
    for ours, theirs in zip(*batches, strict=True):
        difference = np.abs(ours.depth - theirs.depth)
        assert np.median(difference) < 1e-4
        assert (difference > 0.01).mean() < 1e-3
        assert (ours.face != theirs.face).mean() < 3e-3  # of two faces that meet in a pixel, either
        assert np.abs(ours.rgb.astype(int) - theirs.rgb).mean() < color


def test_agrees_with_embree_on_a_generated_flat(flat: Scene, flat_poses: list[np.ndarray]) -> None:
    assert_agree(flat, flat_poses, color=1.5)


def test_agrees_with_embree_on_small_house(small_house: Scene, habitat_views: list) -> None:
    assert_agree(small_house, [view.pose for view in habitat_views[:6]], color=1.0)


def test_a_batch_is_its_single_images_and_only_what_is_asked_for(flat: Scene, flat_poses: list[np.ndarray]) -> None:
    renderer = PyrenderRenderer(flat.mesh, Camera(48, 32))
    batch = renderer.render(np.stack(flat_poses), colors=True, faces=True)
    for pose, image in zip(flat_poses, batch, strict=True):
        for one, other in zip(image, render(renderer, pose), strict=True):
            np.testing.assert_array_equal(one, other)
        (bare,) = renderer.render(pose[None], colors=False, faces=False)
        assert (bare.rgb, bare.face) == (None, None)
        np.testing.assert_array_equal(bare.depth, image.depth)
        assert bare.depth.dtype == np.float32


def test_colours_are_the_albedo(make_quads: Callable[..., Scene]) -> None:
    walls = np.array(
        [
            [[-1, -1, -1], [0, -1, -1], [0, 1, -1], [-1, 1, -1]],
            [[0, -1, -1], [1, -1, -1], [1, 1, -1], [0, 1, -1]],
        ]
    )
    # Seven texels are no multiple of four bytes.
    texture = np.random.default_rng(0).integers(0, 256, (10, 7, 3), dtype=np.uint8)
    materials = (Material("left", (128, 255, 51), texture), Material("right", (90, 120, 200)))
    colors = np.random.default_rng(1).integers(0, 256, (8, 3), dtype=np.uint8)
    for vertex_colors in (None, colors):
        scene = make_quads(walls.astype(float), materials, vertex_colors)
        ours, theirs = (
            render(renderer(scene.mesh, Camera(54, 50)), camera_pose(0, 0, 0, 0))
            for renderer in (EmbreeRenderer, PyrenderRenderer)
        )
        assert np.abs(ours.rgb.astype(int) - theirs.rgb).max() <= 2
        np.testing.assert_array_equal(ours.face // 2, theirs.face // 2)  # on a quad's diagonal either face may be seen


def test_faces_are_seen_from_both_sides_and_numbered_beyond_two_bytes(make_quads: Callable[..., Scene]) -> None:
    walls = np.full((35_001, 4, 3), -9.0)
    walls[:, :, 2] = 5.0  # out of sight, each shrunk to a point but the last
    walls[-1] = [[-9, -9, -1], [9, -9, -1], [9, 9, -1], [-9, 9, -1]]
    scene = make_quads(walls, tuple(Material("m", (10, 20, 30)) for _ in walls))
    renderer = PyrenderRenderer(scene.mesh, Camera(16, 16))
    for z, yaw in ((0.0, 0.0), (-2.0, np.pi)):
        image = render(renderer, camera_pose(0, 0, z, yaw))
        assert (image.rgb == (10, 20, 30)).all()
        assert set(np.unique(image.face)) == {70_000, 70_001}


def test_renderers_come_and_go_without_harm_to_each_other(box: Scene) -> None:
    pose = camera_pose(1.0, 1.25, 1.5, 0.3)
    kept = PyrenderRenderer(box.mesh, Camera(32, 32))
    before = render(kept, pose)
    other = kept.another(Camera(48, 24))
    assert render(other, pose).depth.shape == (24, 48)
    del other
    np.testing.assert_array_equal(render(kept, pose).depth, before.depth)


def test_a_forked_process_is_told_instead_of_hanging(box: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deux.simulator.egl_context._creator", os.getpid() + 1)
    with pytest.raises(DeuxError, match="before this process was forked: start worker processes by spawn"):
        render(PyrenderRenderer(box.mesh, Camera(8, 8)), np.eye(4))


def test_a_model_can_be_trained_after_something_was_drawn() -> None:
    """Mesa and torch's compiler each bring an LLVM: in the wrong order the process crashes."""
    program = (
        "from deux.simulator.egl_context import EGLContext\n"
        "context = EGLContext(8, 8)\n"
        "import torch\n"
        "torch.optim.Adam(torch.nn.Linear(2, 2).parameters())"
    )
    subprocess.run([sys.executable, "-c", program], timeout=120, check=True)
