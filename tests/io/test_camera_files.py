"""Pictures as other programs write them; `tests/tasks/test_predict.py` goes through what is damaged."""

import numpy as np
import pytest
from PIL import Image

from deux.errors import DeuxError
from deux.io.camera_files import read_any_depth, read_any_image


@pytest.fixture
def rgb() -> np.ndarray:
    """Smooth colours, which a JPEG file keeps."""
    rows, columns = np.indices((24, 32))
    return np.stack([4 * rows, 4 * columns, 255 - 4 * rows], axis=-1).astype(np.uint8)


@pytest.mark.parametrize("mode", ["RGB", "CMYK", "YCbCr"])
def test_photographs(tmp_path, rgb, mode):
    Image.fromarray(rgb).convert(mode).save(tmp_path / "a.jpg", quality=95)
    image = read_any_image(tmp_path / "a.jpg")
    assert (image.shape, image.dtype) == (rgb.shape, np.uint8)
    assert np.abs(image.astype(int) - rgb).max() < 12


def test_pixels_stay_where_they_are_stored(tmp_path, rgb):
    exif = Image.Exif()
    exif[0x0112] = 6  # "turn it by 90 degrees"
    Image.fromarray(rgb).save(tmp_path / "a.png", exif=exif)
    np.testing.assert_array_equal(read_any_image(tmp_path / "a.png"), rgb)


@pytest.mark.parametrize(("dtype", "mode"), [(np.uint16, "I;16"), (np.float32, "F"), (np.int32, "I")])
def test_more_than_8_bits_are_refused(tmp_path, dtype, mode):
    Image.fromarray(np.ones((4, 4), dtype)).save(tmp_path / "a.tiff")
    with pytest.raises(DeuxError, match=rf"a\.tiff is an image of mode {mode} where 8 bits a channel are expected"):
        read_any_image(tmp_path / "a.tiff")


def test_a_bomb_is_refused(tmp_path, monkeypatch, rgb):
    Image.fromarray(rgb).save(tmp_path / "a.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    with pytest.raises(DeuxError, match=r"a\.png cannot be read as an image"):
        read_any_image(tmp_path / "a.png")


@pytest.mark.parametrize("scale", [256, 1000, 5000.5])
def test_stored_values_over_the_scale_are_metres(tmp_path, scale):
    stored = np.array([[0, 1, 65535], [256, 1000, 5000]], np.uint16)
    Image.fromarray(stored).save(tmp_path / "d.png")
    np.testing.assert_allclose(read_any_depth(tmp_path / "d.png", scale), stored / scale, rtol=1e-6)
