"""Reading and writing of video files with OpenCV."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import cv2
import numpy as np

from deux.errors import DeuxError
from deux.io.atomic import make_folder

VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v")

ENCODERS = ("vp09", "mp4v")
"""Four-character codes of the encoders of .mp4 files, of which the first available one is used.

Browsers can play the first; the second, MPEG-4 part 2, needs a player such as VLC. The pip packages of OpenCV have no
H.264 encoder for licence reasons.
"""

log = logging.getLogger(__name__)


class VideoReader:
    """Random access to the frames of a video file. Reading forward is fast; going back restarts at the first frame.

    The orientation of phone videos is ignored, because the intrinsics refer to the stored pixels.

    Args:
        path: the file.

    Raises:
        DeuxError: the file is missing or not a video that OpenCV can decode.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise DeuxError(f"{path} is missing.")
        self.path = path
        self._open()

    def __len__(self) -> int:
        """Number of frames according to the file's header."""
        return max(0, int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)))

    def read(self, number: int) -> np.ndarray:
        """Read the frame with an index from 0, H x W x 3 uint8 RGB.

        Raises:
            DeuxError: the video ends before this frame, or is damaged.
        """
        if number < self._next:
            self._capture.release()
            self._open()
        while self._next < number and self._capture.grab():
            self._next += 1
        there, image = self._capture.read()
        if self._next != number or not there:
            raise DeuxError(f"{self.path} has no frame {number}: it ends, or is damaged, after {self._next} frames.")
        self._next += 1
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)

    def _open(self) -> None:
        with _quiet():
            self._capture = cv2.VideoCapture(str(self.path))
            self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        self._next = 0
        if not self._capture.isOpened():
            raise DeuxError(f"{self.path} is not a video that OpenCV can decode.")


class VideoWriter:
    """Writes an .mp4 file atomically; a context manager.

    If OpenCV has none of `ENCODERS`, or its encoder fails, a warning is logged and no file is written.

    Args:
        path: the file.
        rate: frames per second.
    """

    def __init__(self, path: Path, rate: float = 10.0) -> None:
        self.path = path
        self._rate = rate
        self._unfinished = path.with_name(f".{path.stem}.tmp.mp4")  # OpenCV selects the container by the suffix
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._frames = 0

    def __enter__(self) -> "VideoWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._writer is not None:
            self._writer.release()
        if self._writer is None or kind is not None or not self._writer_worked():
            with suppress(OSError):
                self._unfinished.unlink()
            return
        os.replace(self._unfinished, self.path)

    def write(self, image: np.ndarray) -> None:
        """Append an H x W x 3 uint8 RGB image; images of another size than the first are resized and padded."""
        if self._size == (0, 0):
            self._begin(image.shape[1] // 2 * 2, image.shape[0] // 2 * 2)  # encoders need even sides
        if self._writer is not None:
            self._writer.write(cv2.cvtColor(_fitted(image, *self._size), cv2.COLOR_RGB2BGR))
            self._frames += 1

    def _begin(self, width: int, height: int) -> None:
        self._size = (width, height)
        make_folder(self.path.parent)
        for encoder in ENCODERS:
            with _quiet():
                writer = cv2.VideoWriter(
                    str(self._unfinished), cv2.VideoWriter.fourcc(*encoder), self._rate, self._size
                )
            if writer.isOpened():
                self._writer = writer
                return
        log.warning(f"{self.path} is not written: this OpenCV has no encoder for it ({' or '.join(ENCODERS)}).")

    def _writer_worked(self) -> bool:
        """Whether the last frame can be read back: OpenCV does not report failed writes, such as on a full disk."""
        try:
            VideoReader(self._unfinished).read(self._frames - 1)  # reading all takes far less time than writing did
        except DeuxError:
            log.warning(f"{self.path} is not written: OpenCV's encoder failed, the disk may be full.")
            return False
        return True


def _fitted(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """Resize and pad an image with black to width x height; an image that is one pixel too large is cropped."""
    if 0 <= image.shape[0] - height <= 1 and 0 <= image.shape[1] - width <= 1:
        return np.ascontiguousarray(image[:height, :width])
    scale = min(width / image.shape[1], height / image.shape[0])
    size = (max(1, int(image.shape[1] * scale)), max(1, int(image.shape[0] * scale)))
    fitted = np.zeros((height, width, 3), np.uint8)
    fitted[: size[1], : size[0]] = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return fitted


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress OpenCV's messages about files that it cannot open, which are replaced by a DeuxError."""
    logging_module = getattr(getattr(cv2, "utils", None), "logging", None)
    if logging_module is None:
        yield
        return
    before = logging_module.getLogLevel()
    logging_module.setLogLevel(logging_module.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging_module.setLogLevel(before)
