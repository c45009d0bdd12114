import subprocess
import sys

import numpy as np
import pytest
from opengl_suite import OpenGLRendererSuite

from deux.contracts import Scene
from deux.errors import DeuxError
from deux.geometry.camera import Camera
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


class TestPyrenderRenderer(OpenGLRendererSuite):
    renderer = PyrenderRenderer


def test_a_model_can_be_trained_after_something_was_drawn() -> None:
    """Mesa and torch's compiler each bring an LLVM: in the wrong order the process crashes."""
    program = (
        "from deux.simulator.egl_context import EGLContext\n"
        "context = EGLContext(8, 8)\n"
        "import torch\n"
        "torch.optim.Adam(torch.nn.Linear(2, 2).parameters())"
    )
    subprocess.run([sys.executable, "-c", program], timeout=120, check=True)
