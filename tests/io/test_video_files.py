"""Videos: what was written is read back, in any order; and files that are none."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from deux.errors import DeuxError
from deux.io import video_files
from deux.io.video_files import VideoReader, VideoWriter


def pictures(count: int = 6, height: int = 48, width: int = 64) -> list[np.ndarray]:
    """One colour each, since what is encoded loses detail."""
    return [np.full((height, width, 3), (40 * number, 250 - 40 * number, 90), np.uint8) for number in range(count)]


def write(path: Path, images: list[np.ndarray]) -> Path:
    with VideoWriter(path) as video:
        for image in images:
            video.write(image)
        assert not path.exists()
    return path


def test_frames_come_back_in_any_order(tmp_path: Path) -> None:
    images = pictures()
    reader = VideoReader(write(tmp_path / "new" / "a.mp4", images))
    assert len(reader) == 6
    for number in (0, 1, 4, 2, 2, 5):
        image = reader.read(number)
        assert image.shape == images[0].shape
        assert np.abs(image.astype(int) - images[number]).max() <= 12
    with pytest.raises(DeuxError, match="has no frame 6: it ends, or is damaged, after 6 frames"):
        reader.read(6)


def test_sizes_that_are_odd_or_change_are_fitted(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", [*pictures(1, 49, 65), *pictures(1, 90, 60), *pictures(1, 48, 64)])
    reader = VideoReader(path)
    assert [reader.read(number).shape for number in range(3)] == [(48, 64, 3)] * 3


TURNS = {
    "by 90 degrees": (0, 1, 0, -1, 0, 0, 48, 0),
    "upside down": (-1, 0, 0, 0, -1, 0, 64, 48),
}
"""The upper left entries of the matrix in a track's header, by row; phones write it to tell how they were held."""


@pytest.mark.parametrize("turn", TURNS)
def test_pixels_are_taken_as_they_are_stored(tmp_path: Path, turn: str) -> None:
    image = np.full((48, 64, 3), 20, np.uint8)
    image[:16] = 235
    path = write(tmp_path / "a.mp4", [image] * 3)
    content = bytearray(path.read_bytes())
    start = content.index(b"tkhd") + 44
    unit, identity = 1 << 16, (1, 0, 0, 0, 1, 0, 0, 0)
    assert content[start : start + 32] == struct.pack(">8i", *(unit * entry for entry in identity))
    content[start : start + 32] = struct.pack(">8i", *(unit * entry for entry in TURNS[turn]))
    path.write_bytes(content)
    reader = VideoReader(path)
    for number in (2, 0):  # the second makes the reader begin anew
        found = reader.read(number)
        assert found.shape == image.shape
        assert np.abs(found.astype(int) - image)[[0, 8, 24, 40, 47]].max() <= 12


def test_what_is_no_video_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"nothing\.mp4 is missing"):
        VideoReader(tmp_path / "nothing.mp4")
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(DeuxError, match=r"text\.mp4 is not a video that OpenCV can decode"):
        VideoReader(tmp_path / "text.mp4")


def test_an_error_leaves_no_file(tmp_path: Path) -> None:
    def fail() -> None:
        with VideoWriter(tmp_path / "a.mp4") as video:
            video.write(pictures(1)[0])
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert list(tmp_path.iterdir()) == []


ENCODER = cv2.VideoWriter


class FullDisk:
    """An encoder that goes on as if nothing were wrong when nothing fits on the disk any more, as OpenCV's do.

    The file keeps so much of its content, and so many frames.
    """

    kept, frames = 1.0, 1000
    fourcc = staticmethod(ENCODER.fourcc)

    def __init__(self, file: str, *options: Any) -> None:
        self._file, self._encoder = Path(file), ENCODER(file, *options)

    def isOpened(self) -> bool:
        return self._encoder.isOpened()

    def write(self, image: np.ndarray) -> None:
        if self.frames > 0:
            self._encoder.write(image)
        self.frames -= 1

    def release(self) -> None:
        self._encoder.release()
        content = self._file.read_bytes()
        self._file.write_bytes(content[: int(self.kept * len(content))])


@pytest.mark.parametrize("fault", [{"kept": 0.0}, {"kept": 0.5}, {"kept": 0.9}, {"frames": 4}])
def test_a_video_that_lacks_frames_does_not_appear(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, fault: dict[str, float]
) -> None:
    images, path = pictures(), tmp_path / "a.mp4"
    before = write(path, images[:2]).read_bytes()
    monkeypatch.setattr(cv2, "VideoWriter", type("Encoder", (FullDisk,), fault))
    with VideoWriter(path) as video:
        for image in images:
            video.write(image)
    assert caplog.messages == [f"{path} is not written: OpenCV's encoder failed, the disk may be full."]
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]
    assert path.read_bytes() == before


def test_without_an_encoder_it_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(video_files, "ENCODERS", ("none",))
    write(tmp_path / "a.mp4", pictures(2))
    assert list(tmp_path.iterdir()) == []
    assert caplog.messages == [f"{tmp_path}/a.mp4 is not written: this OpenCV has no encoder for it (none)."]
