import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from deux.contracts import Material
from deux.simulator.textures import bilinear_lookup, pack_textures, trilinear_lookup


def noise(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(height + width).integers(0, 256, (height, width, 3), dtype=np.uint8)


def sampled(texture: np.ndarray, s: float, t: float) -> np.ndarray:
    """The texture at (s, t), repeated, by scipy."""
    height, width = texture.shape[:2]
    at = np.array([[(1.0 - t) * height - 0.5], [s * width - 0.5]])
    return np.array([map_coordinates(texture[..., c] / 1.0, at, order=1, mode="grid-wrap")[0] for c in range(3)])


@pytest.mark.parametrize(("height", "width"), [(16, 16), (7, 12), (1, 5), (9, 1)])
def test_lookup_is_bilinear_and_repeats(height: int, width: int) -> None:
    texture = noise(height, width)
    pyramids = pack_textures([Material("m", texture=texture)])
    places = [
        *np.random.default_rng(0).uniform(-3, 3, (200, 2)),
        (0.0, 0.0),
        (1.0, 1.0),
        (-1e-20, 1e-20),
        (-2.0, 5.0),
    ]
    for s, t in places:
        found = bilinear_lookup(pyramids.texels, pyramids.offsets[0, 0], height, width, s, t)
        np.testing.assert_allclose(found, sampled(texture, s, t), atol=1e-6)


def test_levels_average_and_are_blended() -> None:
    texture = noise(16, 16)
    pyramids = pack_textures([Material("m", texture=texture)])
    half = texture.reshape(8, 2, 8, 2, 3).mean(axis=(1, 3))
    quarter = texture.reshape(4, 4, 4, 4, 3).mean(axis=(1, 3))
    for s, t in np.random.default_rng(0).uniform(0, 1, (50, 2)):
        at = {
            level: np.array(trilinear_lookup(pyramids.texels, pyramids.offsets[0], 16, 16, s, t, level))
            for level in (-1.0, 0.0, 1.0, 1.25, 2.0, 4.0, 9.0)
        }
        np.testing.assert_array_equal(at[-1.0], at[0.0])
        np.testing.assert_allclose(at[0.0], sampled(texture, s, t), atol=1e-6)
        # Each level is rounded to whole grey values.
        np.testing.assert_allclose(at[1.0], sampled(half, s, t), atol=0.51)
        np.testing.assert_allclose(at[2.0], sampled(quarter, s, t), atol=1.1)
        np.testing.assert_allclose(at[1.25], 0.75 * at[1.0] + 0.25 * at[2.0], atol=1e-6)
        np.testing.assert_allclose(at[4.0], texture.mean(axis=(0, 1)), atol=2.0)
        np.testing.assert_array_equal(at[9.0], at[4.0])


def test_many_textures_share_one_buffer() -> None:
    first, second = noise(8, 4), noise(5, 6)
    materials = [
        Material("a", texture=first),
        Material("b"),
        Material("c", texture=second),
        Material("d", texture=first),
    ]
    pyramids = pack_textures(materials)
    np.testing.assert_array_equal(pyramids.material_texture, [0, -1, 1, 0])
    np.testing.assert_array_equal(pyramids.sizes, [[8, 4], [5, 6]])
    for number, texture in enumerate((first, second)):
        start = pyramids.offsets[number, 0]
        np.testing.assert_array_equal(pyramids.texels[start : start + texture.size], texture.ravel())
    # 8x4, 4x2, 2x1, 1x1; 5x6, 2x3, 1x1
    assert pyramids.texels.size == 3 * (32 + 8 + 2 + 1 + 30 + 6 + 1)
    assert pack_textures([Material("plain")]).texels.size == 0
