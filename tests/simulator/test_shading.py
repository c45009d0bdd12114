from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from deux.contracts import Material, Scene
from deux.geometry.camera import Camera
from deux.geometry.poses import camera_pose
from deux.simulator.embree_renderer import EmbreeRenderer
from deux.simulator.shading import mip_level, prepare_surfaces

CAMERA = Camera(50, 50, 90.0)
WALL = np.array([[[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]], dtype=float)
"""Fills the view of CAMERA at the origin: the texture's edges are the image's."""
HERE = camera_pose(0.0, 0.0, 0.0, 0.0)


def see(scene: Scene) -> np.ndarray:
    """The colours of a scene from the origin."""
    rgb = EmbreeRenderer(scene.mesh, CAMERA).render(HERE[None])[0].rgb
    assert rgb is not None
    return rgb


def test_a_near_texture_is_seen_upright_and_bilinear(make_quads: Callable[..., Scene]) -> None:
    texture = np.random.default_rng(0).integers(0, 256, (12, 10, 3), dtype=np.uint8)
    rgb = see(make_quads(WALL, (Material("m", texture=texture),)))
    v, u = (np.mgrid[:50, :50] + 0.5) / 50
    for channel in range(3):
        at = [v * 12 - 0.5, u * 10 - 0.5]
        expected = map_coordinates(texture[..., channel].astype(float), at, order=1, mode="grid-wrap")
        assert np.abs(rgb[..., channel] - expected).max() <= 0.51


def test_base_colour_and_vertex_colours_multiply(make_quads: Callable[..., Scene]) -> None:
    texture = np.full((4, 4, 3), (200, 100, 50), dtype=np.uint8)
    corners = np.array([[255, 0, 128], [255, 0, 128], [55, 255, 128], [55, 255, 128]], dtype=np.uint8)
    material = Material("m", (128, 255, 51), texture)
    rgb = see(make_quads(WALL, (material,), corners))
    up = 1.0 - (np.arange(50) + 0.5)[:, None] / 50
    vertex = np.concatenate([255 - 200 * up, 255 * up, np.full_like(up, 128)], axis=1)
    expected = np.array([200, 100, 50]) * np.array([128, 255, 51]) / 255 * vertex / 255
    assert np.abs(rgb - expected[:, None]).max() <= 0.51

    plain = see(make_quads(WALL, (Material("m", (128, 255, 51)),)))
    assert (plain == (128, 255, 51)).all()


def test_a_far_fine_pattern_is_averaged_not_aliased(make_quads: Callable[..., Scene]) -> None:
    checks = np.kron(np.indices((256, 256)).sum(0) % 2 * 255, np.ones((2, 2))).astype(np.uint8)
    texture = np.repeat(checks[..., None], 3, axis=2)
    rgb = see(make_quads(WALL, (Material("m", texture=texture),)))
    # Ten texels a pixel: every pixel covers as much black as white.
    assert np.abs(rgb.astype(int) - 128).max() <= 3


@pytest.mark.parametrize("seed", range(10))
def test_mip_level_is_the_longest_step_in_texels(make_quads: Callable[..., Scene], seed: int) -> None:
    rng = np.random.default_rng(seed)
    origin, across, up = np.array([0, 0, 3.0]), rng.normal(size=3), rng.normal(size=3)
    scene = make_quads(np.array([[origin, origin + across, origin + across + up, origin + up]]), (Material("m"),))
    surfaces = prepare_surfaces(scene.mesh)

    def uv_and_depth(ray: np.ndarray) -> np.ndarray:
        """Solves ray depth = origin + u across + v up."""
        return np.linalg.solve(np.stack([across, up, -ray], axis=1), -origin)

    ray = np.append(rng.uniform(-0.3, 0.3, 2), 1.0)
    right, down = np.array([1e-6, 0, 0]), np.array([0, 1e-6, 0])
    here = uv_and_depth(ray)
    steps = np.stack([uv_and_depth(ray + right) - here, uv_and_depth(ray + down) - here])[:, :2]
    expected = np.log2(np.linalg.norm(steps * (300, 200), axis=1).max())
    found = mip_level(ray, right, down, here[2], surfaces.normal[0], surfaces.uv_gradient[0], 200, 300)
    assert found == pytest.approx(expected, abs=1e-3)
