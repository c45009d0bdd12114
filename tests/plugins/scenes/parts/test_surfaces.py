"""Textures must carry a photometric signal at the distances and image sizes that the robot's camera has."""

import numpy as np
import pytest

from deux_plugins.scenes.parts.draws import Draws
from deux_plugins.scenes.parts.surfaces import MATERIAL_KINDS, Surface, Surfaces

SEEDS = (0, 1)
NEAR_UNIFORM = {"distemper", "linoleum", "screed"}
EXACT = {"damask", "mosaic", "chequers", "ceiling grid"}
HARD = NEAR_UNIFORM | EXACT
"""Made to give a depth model little to match."""


def texture(seed: int, name: str) -> np.ndarray:
    surfaces = Surfaces(seed)
    surfaces.index(Surface(name, 0))
    image = surfaces.materials[0].texture
    assert image is not None
    return image


@pytest.fixture(scope="module", params=SEEDS)
def textures(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    return {name: texture(request.param, name) for name in MATERIAL_KINDS}


def block_means(gray: np.ndarray, blocks: int) -> np.ndarray:
    edge = len(gray) // blocks
    return gray.reshape(blocks, edge, blocks, edge).mean(axis=(1, 3))


def test_textures_are_square_colour_images(textures: dict[str, np.ndarray]):
    for name, image in textures.items():
        assert image.shape == (MATERIAL_KINDS[name].size, MATERIAL_KINDS[name].size, 3)
        assert image.dtype == np.uint8
        assert image.flags.c_contiguous


def test_textures_have_contrast_at_two_scales(textures: dict[str, np.ndarray]):
    for name in textures.keys() - HARD:
        image = textures[name]
        gray = image.astype(np.float64).mean(axis=2)
        coarse = block_means(gray, 16)
        fine = gray - np.kron(coarse, np.ones((len(gray) // 16,) * 2))
        assert coarse.std() > 4.0, name
        assert fine.std() > 4.0, name


def test_no_part_of_a_texture_is_blank(textures: dict[str, np.ndarray]):
    """In every tenth of a texture's edge, 13 to 26 cm of a wall, something is to be seen."""
    for name in textures.keys() - HARD:
        image = textures[name]
        gray = image.astype(np.float64).mean(axis=2)
        edge = len(gray) // 10
        blocks = gray[: edge * 10, : edge * 10].reshape(10, edge, 10, edge)
        assert np.percentile(blocks.std(axis=(1, 3)), 5) > 1.0, name


def test_near_uniform_textures_are(textures: dict[str, np.ndarray]):
    """Less contrast in a patch of 16 cm than any of the rich textures, but never none."""
    local = {}
    for name, image in textures.items():
        gray = image.astype(np.float64).mean(axis=2)
        edge = len(gray) // 16
        local[name] = np.median(gray.reshape(16, edge, 16, edge).std(axis=(1, 3)))
    least = min(local[name] for name in local.keys() - HARD)
    for name in NEAR_UNIFORM:
        assert 0.3 < local[name] < least, name


def test_repeated_textures_repeat(textures: dict[str, np.ndarray]):
    """Some shift of at most half the texture maps it nearly onto itself; no rich wallpaper has one."""
    changes = {}
    for name in (*EXACT, "flowered wallpaper", "brick", "wall tiles"):
        gray = textures[name].astype(np.float64).mean(axis=2)
        power = np.abs(np.fft.fft2(gray - gray.mean())) ** 2
        correlation = np.fft.ifft2(power).real / power.sum() * gray.size
        changes[name] = correlation[32:257, 32:257].max()
    for name in EXACT:
        assert changes[name] > 0.95, changes
        assert changes[name] > max(changes["flowered wallpaper"], changes["brick"], changes["wall tiles"])


def test_textures_are_band_limited(textures: dict[str, np.ndarray]):
    """Less than a fifth of the power lies at periods below three texels, where sampling would flicker."""
    frequency = {size: np.abs(np.fft.fftfreq(size)) for size in (256, 512)}
    for name, image in textures.items():
        gray = image.astype(np.float64).mean(axis=2)
        power = np.abs(np.fft.fft2(gray - gray.mean())) ** 2
        axis = frequency[len(gray)]
        high = np.maximum(axis[:, None], axis[None, :]) > 1 / 3
        assert power[high].sum() < 0.1 * power.sum(), name


def test_textures_repeat_without_a_seam(textures: dict[str, np.ndarray]):
    for name, image in textures.items():
        if MATERIAL_KINDS[name].fit != "none":
            continue
        gray = image.astype(np.float64).mean(axis=2)
        for axis in (0, 1):
            steps = np.abs(np.diff(gray, axis=axis, append=np.take(gray, [0], axis=axis)))
            profile = steps.mean(axis=1 - axis)
            assert profile[-1] <= 1.5 * np.percentile(profile, 99), (name, axis)


def test_a_texture_does_not_depend_on_what_was_made_before():
    surfaces = Surfaces(5)
    for name in ("planks", "brick", "wood"):
        surfaces.index(Surface(name, 0))
    assert np.array_equal(surfaces.materials[2].texture, texture(5, "wood"))


def test_materials_share_their_textures():
    surfaces = Surfaces(0)
    first = surfaces.index(Surface("wood", 0))
    second = surfaces.index(Surface("wood", 0, (200, 190, 180)))
    assert first != second
    assert surfaces.index(Surface("wood", 0)) == first
    assert surfaces.materials[first].texture is surfaces.materials[second].texture


def test_picked_surfaces_are_among_the_variants():
    surfaces, draws = Surfaces(0), Draws(0, "test")
    for _ in range(50):
        surface = surfaces.pick(draws, "wood", "brick")
        assert surface.kind in ("wood", "brick")
        assert 0 <= surface.variant < MATERIAL_KINDS[surface.kind].variants
