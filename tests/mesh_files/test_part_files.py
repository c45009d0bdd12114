import numpy as np
import pytest
from PIL import Image

from deux.errors import DeuxError
from deux.mesh_files.part_files import find_part, limited_texture, read_texture, reduction


def noise(height: int, width: int, channels: int = 3) -> np.ndarray:
    return np.random.default_rng(height * width).integers(0, 256, (height, width, channels), np.uint8)


@pytest.mark.parametrize(
    "name", ["a b.png", "sub\\a b.png", "sub/a%20b.png", '"a b.png"', "D:\\x\\a b.png", "/x/a b.png"]
)
def test_names_from_other_machines(tmp_path, name):
    (tmp_path / "sub").mkdir()
    for folder in ("", "sub"):
        (tmp_path / folder / "a b.png").touch()
    assert find_part(name, tmp_path / "scene.obj") == tmp_path / ("sub" if name.startswith("sub") else "") / "a b.png"


def test_a_missing_part_is_named_with_its_owner(tmp_path):
    with pytest.raises(DeuxError, match=r"scene\.obj needs sub/wall\.png, which is not in"):
        find_part("sub/wall.png", tmp_path / "scene.obj")


def test_images_of_all_kinds_are_three_bytes_a_pixel(tmp_path):
    pixels = noise(5, 7)
    path = tmp_path / "image.png"
    for image, expected in [
        (Image.fromarray(pixels), pixels),
        (Image.fromarray(np.dstack([pixels, pixels[..., :1]])), pixels),
        (Image.fromarray(pixels[..., 0]), np.repeat(pixels[..., :1], 3, axis=2)),
        (Image.fromarray(pixels[..., 0].astype(np.uint16) * 257), np.repeat(pixels[..., :1], 3, axis=2)),
    ]:
        image.save(path)
        np.testing.assert_array_equal(read_texture(path), expected)


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_large_images_are_halved_until_they_fit(tmp_path, suffix):
    smooth = np.asarray(Image.fromarray(noise(5, 10)).resize((400, 200), Image.Resampling.BICUBIC))
    Image.fromarray(smooth).save(tmp_path / f"image.{suffix}", quality=95)
    whole = read_texture(tmp_path / f"image.{suffix}")
    small = read_texture(tmp_path / f"image.{suffix}", 150)
    assert (whole.shape, small.shape) == ((200, 400, 3), (50, 100, 3))
    mean = whole.reshape(50, 4, 100, 4, 3).mean(axis=(1, 3))
    assert np.abs(small - mean).max() <= 4
    np.testing.assert_allclose(limited_texture(whole, 150), mean, atol=0.51)
    assert limited_texture(whole, 400) is whole


def test_reduction_is_the_least_power_of_two():
    assert [reduction((100, 30), longest) for longest in (None, 1000, 100, 99, 50, 49, 1)] == [1, 1, 1, 2, 2, 4, 64]


def test_a_damaged_image_is_named(tmp_path):
    Image.fromarray(noise(50, 50)).save(tmp_path / "image.png")
    (tmp_path / "image.png").write_bytes((tmp_path / "image.png").read_bytes()[:1000])
    with pytest.raises(DeuxError, match=r"image\.png cannot be read as an image"):
        read_texture(tmp_path / "image.png")
