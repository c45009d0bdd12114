"""Pictures as other programs write them; `tests/tasks/test_predict.py` goes through what is damaged."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from deux.errors import DeuxError
from deux.io.camera_files import read_any_depth, read_any_image, read_any_intrinsics
from deux.io.images import read_image


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


@pytest.mark.parametrize("channels", [2, 3, 4])
@pytest.mark.parametrize("factor", [257, 16, 4])
def test_colours_of_16_bits_are_refused_however_many_are_used(tmp_path, rgb, channels, factor):
    """Pillow gives the upper byte: of a 10-bit picture 0 to 3."""
    pixels = np.repeat(rgb[..., :1], 4, axis=2)[..., :channels] if channels == 2 else np.dstack([rgb, rgb[..., :1]])
    write_png(tmp_path / "a.png", pixels[..., :channels].astype(np.uint16) * factor)
    for read in (read_any_image, read_image):
        with pytest.raises(
            DeuxError, match=r"a\.png is an image of 16 bits per channel where 8 are expected: convert it"
        ):
            read(tmp_path / "a.png")


def write_png(path, pixels):
    """Write H x W x 2, 3 or 4 uint16 as a PNG file, chunk by chunk."""
    height, width, channels = pixels.shape
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in pixels)
    header = struct.pack(">IIBBBBB", width, height, 16, {2: 4, 3: 2, 4: 6}[channels], 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED).dtype == np.uint16


def test_a_png_without_its_end_is_truncated(tmp_path, rgb):
    Image.fromarray(rgb).save(tmp_path / "a.png")
    content = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(content[:-12])
    with pytest.raises(DeuxError, match=r"a\.png is truncated"):
        read_any_image(tmp_path / "a.png")


@pytest.mark.parametrize("name", ["d.tiff", "d.TIF", "d.exr"])
def test_depth_in_floating_point_pictures_is_refused(tmp_path, name):
    Image.fromarray(np.ones((4, 4), np.float32)).save(tmp_path / name, format="TIFF")
    with pytest.raises(DeuxError, match=rf"{name} has a format that is not supported for depth: convert it to a \.npy"):
        read_any_depth(tmp_path / name)


@pytest.mark.parametrize(("pixels", "mode"), [(np.ones((4, 4), np.uint8), "L"), (np.ones((4, 4, 3), np.uint8), "RGB")])
def test_depth_of_8_bits_is_refused(tmp_path, pixels, mode):
    Image.fromarray(pixels).save(tmp_path / "d.png")
    with pytest.raises(DeuxError, match=rf"d\.png is an image of mode {mode} where a 16-bit depth map is expected"):
        read_any_depth(tmp_path / "d.png")
    Image.fromarray(pixels).save(tmp_path / "d.jpg")
    with pytest.raises(DeuxError, match=r"d\.jpg is not a PNG file .*: a 16-bit depth map in PNG format is expected"):
        read_any_depth(tmp_path / "d.jpg")


@pytest.mark.parametrize(("dtype", "mode"), [(np.uint16, "I;16"), (np.float32, "F"), (np.int32, "I")])
def test_more_than_8_bits_are_refused(tmp_path, dtype, mode):
    Image.fromarray(np.ones((4, 4), dtype)).save(tmp_path / "a.tiff")
    with pytest.raises(DeuxError, match=rf"a\.tiff is an image of mode {mode}: 8 bits per channel are expected"):
        read_any_image(tmp_path / "a.tiff")


def test_a_bomb_is_refused(tmp_path, leave_memory, rgb):
    Image.fromarray(rgb).save(tmp_path / "a.png")
    leave_memory(20_000)
    with pytest.raises(DeuxError, match=r"a\.png, of .* pixels, would take .* GiB of memory"):
        read_any_image(tmp_path / "a.png")


@pytest.mark.parametrize("scale", [256, 1000, 5000.5])
def test_stored_values_over_the_scale_are_metres(tmp_path, scale):
    stored = np.array([[0, 1, 65534], [256, 1000, 5000]], np.uint16)
    Image.fromarray(stored).save(tmp_path / "d.png")
    np.testing.assert_allclose(read_any_depth(tmp_path / "d.png", scale), stored / scale, rtol=1e-6)


def test_the_ending_of_an_array_may_be_in_capitals(tmp_path):
    depth, matrix = np.full((4, 6), 1.5, np.float32), np.array([[30.0, 0, 2.5], [0, 30, 1.5], [0, 0, 1]])
    for name, array in (("d.NPY", depth), ("K.Npy", matrix)):
        with (tmp_path / name).open("wb") as file:
            np.save(file, array)
    np.testing.assert_array_equal(read_any_depth(tmp_path / "d.NPY"), depth)
    np.testing.assert_array_equal(read_any_intrinsics(tmp_path / "K.Npy"), matrix)
