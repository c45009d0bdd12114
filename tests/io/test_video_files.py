"""Videos: what was written is read back, in any order; and files that are none."""

from pathlib import Path

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


def test_what_is_no_video_is_said(tmp_path: Path) -> None:
    with pytest.raises(DeuxError, match=r"nothing\.mp4 is missing"):
        VideoReader(tmp_path / "nothing.mp4")
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(DeuxError, match=r"text\.mp4 is no video that OpenCV can decode"):
        VideoReader(tmp_path / "text.mp4")


def test_an_error_leaves_no_file(tmp_path: Path) -> None:
    def fail() -> None:
        with VideoWriter(tmp_path / "a.mp4") as video:
            video.write(pictures(1)[0])
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_without_an_encoder_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(video_files, "ENCODERS", ("none",))
    write(tmp_path / "a.mp4", pictures(2))
    assert list(tmp_path.iterdir()) == []
    assert caplog.messages == [f"{tmp_path}/a.mp4 is not written: this OpenCV has no encoder for it (none)."]
