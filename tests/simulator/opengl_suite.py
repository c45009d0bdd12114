"""What holds for every renderer that draws by OpenGL; a subclass says which it is."""

import os
from collections.abc import Callable

import numpy as np
import pytest

from deux.contracts import Material, Scene
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.simulator.embree_renderer import EmbreeRenderer
from deux.simulator.renderers import RenderedImage, Renderer


def render(renderer: Renderer, pose: np.ndarray) -> RenderedImage:
    """All that can be asked of one pose."""
    return renderer.render(pose[None], colors=True, faces=True)[0]


class OpenGLRendererSuite:
    """Subclass it and set `renderer`."""

    renderer: type

    def test_a_batch_is_its_single_images_and_only_what_is_asked_for(
        self, flat: Scene, flat_poses: list[np.ndarray]
    ) -> None:
        renderer = self.renderer(flat.mesh, Camera(48, 32))
        batch = renderer.render(np.stack(flat_poses), colors=True, faces=True)
        for pose, image in zip(flat_poses, batch, strict=True):
            for one, other in zip(image, render(renderer, pose), strict=True):
                np.testing.assert_array_equal(one, other)
            (bare,) = renderer.render(pose[None], colors=False, faces=False)
            assert (bare.rgb, bare.face) == (None, None)
            np.testing.assert_array_equal(bare.depth, image.depth)
            assert bare.depth.dtype == np.float32

    def test_colours_are_the_albedo(self, make_quads: Callable[..., Scene]) -> None:
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
                for renderer in (EmbreeRenderer, self.renderer)
            )
            assert np.abs(ours.rgb.astype(int) - theirs.rgb).max() <= 2
            np.testing.assert_array_equal(
                ours.face // 2, theirs.face // 2
            )  # on a quad's diagonal either face may be seen

    def test_faces_are_seen_from_both_sides_and_numbered_beyond_two_bytes(
        self, make_quads: Callable[..., Scene]
    ) -> None:
        walls = np.full((35_001, 4, 3), -9.0)
        walls[:, :, 2] = 5.0  # out of sight, each shrunk to a point but the last
        walls[-1] = [[-9, -9, -1], [9, -9, -1], [9, 9, -1], [-9, 9, -1]]
        scene = make_quads(walls, tuple(Material("m", (10, 20, 30)) for _ in walls))
        renderer = self.renderer(scene.mesh, Camera(16, 16))
        for z, yaw in ((0.0, 0.0), (-2.0, np.pi)):
            image = render(renderer, camera_pose(0, 0, z, yaw))
            assert (image.rgb == (10, 20, 30)).all()
            assert set(np.unique(image.face)) == {70_000, 70_001}

    def test_renderers_come_and_go_without_harm_to_each_other(self, box: Scene) -> None:
        pose = camera_pose(1.0, 1.25, 1.5, 0.3)
        kept = self.renderer(box.mesh, Camera(32, 32))
        before = render(kept, pose)
        other = kept.another(Camera(48, 24))
        assert render(other, pose).depth.shape == (24, 48)
        del other
        np.testing.assert_array_equal(render(kept, pose).depth, before.depth)

    def test_a_forked_process_gets_an_error_instead_of_hanging(
        self, box: Scene, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("deux.simulator.egl_context._creator", os.getpid() + 1)
        with pytest.raises(DeuxError, match="before this process was forked: start worker processes by spawn"):
            render(self.renderer(box.mesh, Camera(8, 8)), np.eye(4))
