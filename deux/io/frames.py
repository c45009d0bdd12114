"""Collected frames on disk. The pose is written last, so a frame with a pose is complete."""

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType

import numpy as np

from deux.contracts import Frame
from deux.errors import DeuxError
from deux.io.atomic import make_folder
from deux.io.calibration import read_pose, write_matrix
from deux.io.images import read_depth, read_image, read_labels, write_depth, write_image, write_labels
from deux.io.layout import SequencePaths, frame_name

_MOST_PENDING = 8
"""Greatest number of frames that wait to be written before the collector blocks."""


def write_frame(paths: SequencePaths, index: int, frame: Frame) -> None:
    """Write a frame's image, depth, labels (if it has them) and pose.

    Raises:
        DeuxError: a file cannot be written, for example because the disk is full.
    """
    name = frame_name(index)
    write_image(paths.file("image", name), frame.rgb)
    write_depth(paths.file("ground_truth", name), frame.depth)
    if frame.labels is not None:
        write_labels(paths.file("labels", name), frame.labels)
    write_matrix(paths.file("absolute_pose", name), frame.pose)


def read_frame(paths: SequencePaths, index: int, labels: bool) -> Frame | None:
    """Read a collected frame; None if it is incomplete or damaged.

    Args:
        paths: the paths of the sequence.
        index: index of the frame.
        labels: whether to read the labels too.
    """
    name = frame_name(index)
    if not paths.file("absolute_pose", name).exists():
        return None
    try:
        return Frame(
            rgb=read_image(paths.file("image", name)),
            depth=read_depth(paths.file("ground_truth", name)),
            pose=read_pose(paths.file("absolute_pose", name)),
            labels=read_labels(paths.file("labels", name)) if labels else None,
        )
    except DeuxError:  # a power failure can leave an empty file despite the atomic rename
        return None


def prepare_folders(paths: SequencePaths, intrinsics: np.ndarray, labels: bool) -> None:
    """Create a sequence's folders, and write its K.txt if it does not exist."""
    for kind in ("image", "ground_truth", "absolute_pose", *(["labels"] if labels else [])):
        make_folder(paths.folder / kind)
    if not paths.intrinsics.exists():
        write_matrix(paths.intrinsics, intrinsics)


class FrameWriter:
    """Writes frames in order in a background thread; a context manager."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(max_workers=1)
        self._pending: deque[Future[None]] = deque()

    def __enter__(self) -> "FrameWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(cancel_futures=error is not None)
        if error is None:
            self._wait(0)

    def put(self, paths: SequencePaths, index: int, frame: Frame) -> None:
        """Queue a frame for writing; its arrays must not be modified afterwards.

        Raises:
            DeuxError: an earlier frame could not be written.
        """
        self._wait(_MOST_PENDING)
        self._pending.append(self._pool.submit(write_frame, paths, index, frame))

    def _wait(self, pending: int) -> None:
        while len(self._pending) > pending:
            self._pending.popleft().result()
