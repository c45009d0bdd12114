"""PNG files: what is written comes back, and what is damaged is refused by name."""

import errno
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from deux.errors import DeuxError
from deux.io import images


def test_image_round_trip_keeps_channel_order(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (12, 17, 3), dtype=np.uint8)
    images.write_image(tmp_path / "a.png", image)
    np.testing.assert_array_equal(images.read_image(tmp_path / "a.png"), image)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), image)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_depth_is_stored_as_metres_times_256(tmp_path: Path) -> None:
    depth = np.array([[0.0, 1.0, 2.5, 10.0], [0.001, np.nan, -1.0, 300.0]], dtype=np.float32)
    images.write_depth(tmp_path / "d.png", depth)
    stored = cv2.imread(str(tmp_path / "d.png"), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    np.testing.assert_array_equal(stored, [[0, 256, 640, 2560], [0, 0, 0, 0]])


@pytest.mark.parametrize("scale", [256.0, 1000.0, 5000.0])
def test_the_largest_stored_value_is_no_depth(tmp_path: Path, scale: float) -> None:
    """Recordings mark with it what was not measured: as a distance it would be 65.5 m in a room."""
    Image.fromarray(np.array([[0, 2000, 65534, 65535]], np.uint16)).save(tmp_path / "d.png")
    expected = np.array([[0, 2000, 65534, 0]], np.float32) / np.float32(scale)
    np.testing.assert_array_equal(images.read_depth(tmp_path / "d.png", scale), expected)


def test_the_largest_stored_value_is_never_written(tmp_path: Path) -> None:
    depth = np.array([[65534, 65535, 65535.4, 65536]], np.float32) / np.float32(256)
    images.write_depth(tmp_path / "d.png", depth)
    np.testing.assert_array_equal(images.read_depth(tmp_path / "d.png"), [[images.LARGEST_DEPTH, 0, 0, 0]])
    np.testing.assert_array_equal(images.quantise_depth(depth), [[images.LARGEST_DEPTH, 0, 0, 0]])


def test_quantised_depth_is_what_reading_returns(tmp_path: Path) -> None:
    depth = np.random.default_rng(1).uniform(0.0, 12.0, (30, 40)).astype(np.float32)
    images.write_depth(tmp_path / "d.png", depth)
    quantised = images.quantise_depth(depth)
    np.testing.assert_array_equal(images.read_depth(tmp_path / "d.png"), quantised)
    assert quantised.dtype == np.float32
    assert np.abs(quantised - depth).max() <= 0.5 / 256 + 1e-6
    np.testing.assert_array_equal(images.quantise_depth(quantised), quantised)


def test_label_round_trip(tmp_path: Path) -> None:
    labels = np.array([[-1, 0, 40]], dtype=np.int32)
    images.write_labels(tmp_path / "l.png", labels)
    np.testing.assert_array_equal(images.read_labels(tmp_path / "l.png"), labels)


@pytest.mark.parametrize("kept", [0.0, 0.1, 0.5, 0.95, 0.999])
def test_a_truncated_file_is_refused_by_name(tmp_path: Path, kept: float) -> None:
    file = tmp_path / "broken.png"
    images.write_image(file, np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8))
    content = file.read_bytes()
    file.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(DeuxError, match=r"broken\.png is truncated"):
        images.read_image(file)


def test_a_flipped_bit_is_noticed(tmp_path: Path) -> None:
    file = tmp_path / "broken.png"
    images.write_depth(file, np.random.default_rng(0).uniform(0, 9, (64, 64)))
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x10
    file.write_bytes(content)
    with pytest.raises(DeuxError, match=r"broken\.png is damaged"):
        images.read_depth(file)


def test_the_wrong_kind_of_image_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.png"
    images.write_depth(file, np.ones((4, 4)))
    with pytest.raises(DeuxError, match=r"a\.png is an image of mode .* where an 8-bit RGB image is expected"):
        images.read_image(file)
    images.write_image(file, np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(DeuxError, match="where a 16-bit depth map is expected"):
        images.read_depth(file)


def test_more_pixels_than_anybody_means_are_refused(tmp_path: Path, leave_memory: Callable[[int], None]) -> None:
    images.write_image(tmp_path / "a.png", np.zeros((40, 40, 3), np.uint8))
    leave_memory(200_000)
    with pytest.raises(DeuxError, match=r"a\.png, of 40 x 40 pixels, would take .* GiB of memory"):
        images.read_image(tmp_path / "a.png")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"nothing\.png is missing"):
        images.read_image(tmp_path / "nothing.png")


def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "d.png"
    images.write_depth(file, np.ones((8, 8)))
    before = file.read_bytes()
    write = Path.write_bytes

    def half_written(path: Path, content: bytes) -> int:
        write(path, content[: len(content) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", half_written)
    with pytest.raises(
        DeuxError, match=r"The disk is full: .*d\.png \(\d+ kB\) could not be written, [\d,]+ kB are free"
    ):
        images.write_depth(file, np.zeros((8, 8)))
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_fractions_come_back_and_what_is_above_zero_stays_so(tmp_path):
    fractions = np.array([[0.0, 1e-9, 0.25, 1.0]], np.float32)
    (tmp_path / "a.png").write_bytes(images.encode_fraction(fractions))
    found = images.read_fraction(tmp_path / "a.png")
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, fractions, atol=1 / 65535)
    assert (found > 0).tolist() == [[False, True, True, True]]
