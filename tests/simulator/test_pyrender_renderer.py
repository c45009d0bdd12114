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


@pytest.fixture(scope="module", autouse=True)
def _opengl() -> None:
    try:
        EGLContext(8, 8)
    except DeuxError as error:
        pytest.skip(str(error))


def assert_agree(scene: Scene, poses: list[np.ndarray], color: float) -> None:
    """Both renderers see the same, and colours differ by at most `color` grey levels on average."""
    camera = Camera(256, 256)
    embree, pyrender = EmbreeRenderer(scene, camera), PyrenderRenderer(scene, camera)
    for pose in poses:
        ours, theirs = embree.render(pose), pyrender.render(pose)
        difference = np.abs(ours.depth - theirs.depth)
        assert np.median(difference) < 1e-4
        assert (difference > 0.01).mean() < 1e-3
        assert (ours.labels != theirs.labels).mean() < 2e-3
        assert np.abs(ours.rgb.astype(int) - theirs.rgb).mean() < color


def test_agrees_with_embree_on_a_generated_flat(flat: Scene, flat_poses: list[np.ndarray]) -> None:
    assert_agree(flat, flat_poses, color=1.5)


def test_agrees_with_embree_on_small_house(small_house: Scene, habitat_views: list) -> None:
    assert_agree(small_house, [view.pose for view in habitat_views[:6]], color=1.0)


def test_depth_alone_is_that_of_the_image(flat: Scene, flat_poses: list[np.ndarray]) -> None:
    renderer = PyrenderRenderer(flat, Camera(48, 32))
    for pose in flat_poses[:3]:
        depth = renderer.depth(pose)
        assert depth.dtype == np.float32
        image = renderer.render(pose)
        np.testing.assert_array_equal(depth, image.depth)
        for alone, whole in zip(renderer.labelled_depth(pose), (image.depth, image.labels), strict=True):
            np.testing.assert_array_equal(alone, whole)


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
            renderer(scene, Camera(54, 50)).render(camera_pose(0, 0, 0, 0))
            for renderer in (EmbreeRenderer, PyrenderRenderer)
        )
        assert np.abs(ours.rgb.astype(int) - theirs.rgb).max() <= 2
        np.testing.assert_array_equal(ours.labels, theirs.labels)


def test_faces_are_seen_from_both_sides_and_labels_beyond_a_byte(make_quads: Callable[..., Scene]) -> None:
    wall = np.array([[[-9, -9, -1], [9, -9, -1], [9, 9, -1], [-9, 9, -1]]], dtype=float)
    scene = make_quads(wall, (Material("m", (10, 20, 30)),))
    scene.mesh.face_label[:] = 70_000
    renderer = PyrenderRenderer(scene, Camera(16, 16))
    for z, yaw in ((0.0, 0.0), (-2.0, np.pi)):
        image = renderer.render(camera_pose(0, 0, z, yaw))
        assert (image.rgb == (10, 20, 30)).all()
        assert (image.labels == 70_000).all()
        assert renderer.render(camera_pose(0, 0, z, yaw), labels=False).labels is None


def test_renderers_come_and_go_without_harm_to_each_other(box: Scene) -> None:
    pose = camera_pose(1.0, 1.25, 1.5, 0.3)
    kept = PyrenderRenderer(box, Camera(32, 32))
    before = kept.render(pose)
    other = PyrenderRenderer(box, Camera(48, 24))
    assert other.render(pose).depth.shape == (24, 48)
    del other
    np.testing.assert_array_equal(kept.render(pose).depth, before.depth)


def test_a_forked_process_is_told_instead_of_hanging(box: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deux.simulator.egl_context._creator", os.getpid() + 1)
    with pytest.raises(DeuxError, match="before this process was forked: start worker processes by spawn"):
        PyrenderRenderer(box, Camera(8, 8)).render(np.eye(4))


def test_a_model_can_be_trained_after_something_was_drawn() -> None:
    """Mesa and torch's compiler each bring an LLVM: in the wrong order the process crashes."""
    program = (
        "from deux.simulator.egl_context import EGLContext\n"
        "context = EGLContext(8, 8)\n"
        "import torch\n"
        "torch.optim.Adam(torch.nn.Linear(2, 2).parameters())"
    )
    subprocess.run([sys.executable, "-c", program], timeout=120, check=True)
