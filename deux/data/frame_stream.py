"""Recorded frames in sequence, read ahead in a thread."""

from collections import OrderedDict, deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from deux.contracts import FrameReference, Reader
from deux.data.checked_frames import ground_truth_of, image_of, intrinsics_of, pose_of, sparse_depth_of
from deux.data.frame_sizes import check_one_size
from deux.geometry.poses import absorb_intrinsics, source_from_target
from deux.geometry.source_frames import SourceRule

_AHEAD = 8
"""Number of frames that are read ahead."""

_CACHED_IMAGES = 4 * SourceRule().reach
"""Number of cached images: each may be a source frame of its neighbours."""


@dataclass(frozen=True)
class SourceImage:
    """A source frame of a recorded frame.

    Args:
        image: H x W x 3 uint8, of the frame's size.
        source_from_target: 4 x 4, transforms points of the frame's camera to the source camera, to be projected with
            the frame's intrinsics.
    """

    image: np.ndarray
    source_from_target: np.ndarray


@dataclass(frozen=True)
class RecordedFrame:
    """A recorded frame.

    Args:
        image: H x W x 3 uint8.
        sparse_depth: H x W float32 metres, 0 = none.
        intrinsics: 3 x 3.
        ground_truth: H x W float32 metres, 0 = none; None if there is none.
        pose: 4 x 4 camera-to-world; None if there is none.
        sources: its source frames; empty if they are not requested.
    """

    image: np.ndarray
    sparse_depth: np.ndarray
    intrinsics: np.ndarray
    ground_truth: np.ndarray | None = None
    pose: np.ndarray | None = None
    sources: tuple[SourceImage, ...] = ()


class FrameStream:
    """Reads frames of a folder in a background thread, in the given order.

    Args:
        reader: the reader of the folder.
        sources: the source frames of each frame, all with poses; None to read no source frames.
        depths: whether sparse depth and ground truth are read; otherwise the sparse depth is 0 and the truth None.
    """

    def __init__(
        self,
        reader: Reader,
        sources: Mapping[FrameReference, Sequence[FrameReference]] | None = None,
        depths: bool = True,
    ) -> None:
        self._reader = reader
        self._depths = depths
        self._sources = sources or {}
        self._images: OrderedDict[FrameReference, np.ndarray] = OrderedDict()

    def __call__(self, frames: Sequence[FrameReference]) -> Iterator[tuple[FrameReference, RecordedFrame]]:
        """Iterate over the frames, each with its reference.

        Raises:
            DeuxError: a file is missing or damaged, or a depth map is of another size than its image.
        """
        with ThreadPoolExecutor(max_workers=1) as pool:
            pending: deque[tuple[FrameReference, Future[RecordedFrame]]] = deque()
            try:
                for frame in frames:
                    pending.append((frame, pool.submit(self.read, frame)))
                    if len(pending) > _AHEAD:
                        name, future = pending.popleft()
                        yield name, future.result()
                while pending:
                    name, future = pending.popleft()
                    yield name, future.result()
            finally:
                pool.shutdown(cancel_futures=True)

    def read(self, frame: FrameReference) -> RecordedFrame:
        """Read one frame.

        Raises:
            DeuxError: as `__call__`.
        """
        image = self._image(frame)
        sparse_depth, truth = np.zeros(image.shape[:2], np.float32), None
        if self._depths:
            sparse_depth, truth = sparse_depth_of(self._reader, frame), ground_truth_of(self._reader, frame)
        depths = [("sparse depth", sparse_depth.shape)] + ([] if truth is None else [("ground truth", truth.shape)])
        check_one_size(self._reader, frame, image.shape[:2], depths)
        pose = pose_of(self._reader, frame)
        intrinsics = intrinsics_of(self._reader, frame)
        others = self._sources.get(frame, ())
        found = [] if pose is None else [self._source(pose, intrinsics, source) for source in others]
        sources = tuple(source for source in found if source is not None and source.image.shape == image.shape)
        return RecordedFrame(image, sparse_depth, intrinsics, truth, pose, sources)

    def _source(self, target: np.ndarray, intrinsics: np.ndarray, frame: FrameReference) -> SourceImage | None:
        pose = pose_of(self._reader, frame)
        if pose is None:
            return None
        motion = absorb_intrinsics(source_from_target(target, pose), intrinsics, intrinsics_of(self._reader, frame))
        return SourceImage(self._image(frame), motion)

    def _image(self, frame: FrameReference) -> np.ndarray:
        """Read an image; if source frames are read, recent images are cached."""
        if not self._sources:
            return image_of(self._reader, frame)
        if frame not in self._images:
            self._images[frame] = image_of(self._reader, frame)
            if len(self._images) > _CACHED_IMAGES:
                self._images.popitem(last=False)
        return self._images[frame]
