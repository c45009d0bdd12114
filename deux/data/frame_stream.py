"""Recorded frames one after the other, whole, read ahead of whoever works on them."""

from collections import OrderedDict, deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from deux.contracts import FrameReference, Reader
from deux.data.frame_sizes import check_one_size
from deux.geometry.poses import projecting_alike, source_from_target
from deux.geometry.source_frames import SourceRule

_AHEAD = 8
"""Frames that are read while earlier ones are worked on."""

_KEPT = 4 * SourceRule().reach
"""Images that are kept, since each is a source frame of its neighbours."""


@dataclass(frozen=True)
class SourceImage:
    """A source frame of a frame.

    Args:
        image: H x W x 3 uint8, of the frame's size.
        source_from_target: 4 x 4, carries points of the frame's camera into the source camera, for the frame's camera
            matrix to project them.
    """

    image: np.ndarray
    source_from_target: np.ndarray


@dataclass(frozen=True)
class RecordedFrame:
    """A frame as it was recorded.

    Args:
        image: H x W x 3 uint8.
        sparse_depth: H x W float32 metres, 0 = none.
        intrinsics: 3 x 3.
        ground_truth: H x W float32 metres, 0 = none; None if there is none.
        pose: 4 x 4 camera-to-world; None if there is none.
        sources: the frames that it is compared with; none where nothing compares.
    """

    image: np.ndarray
    sparse_depth: np.ndarray
    intrinsics: np.ndarray
    ground_truth: np.ndarray | None = None
    pose: np.ndarray | None = None
    sources: tuple[SourceImage, ...] = ()


class FrameStream:
    """Reads frames of a folder on a thread of its own, in the order that is asked for.

    Args:
        reader: of the folder.
        sources: the source frames of each frame that has some, all with poses; None where nothing compares.
        depths: whether sparse points and ground truth are read; without, frames come with no point and no truth.
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
        """The frames, each with its name.

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
        """One frame; raises as the stream."""
        image = self._image(frame)
        sparse_depth, truth = np.zeros(image.shape[:2], np.float32), None
        if self._depths:
            sparse_depth, truth = self._reader.sparse_depth(frame), self._reader.ground_truth(frame)
        depths = [("sparse depth", sparse_depth.shape)] + ([] if truth is None else [("ground truth", truth.shape)])
        check_one_size(self._reader, frame, image.shape[:2], depths)
        pose = self._reader.pose(frame)
        intrinsics = self._reader.intrinsics(frame)
        others = self._sources.get(frame, ())
        found = [] if pose is None else [self._source(pose, intrinsics, source) for source in others]
        sources = tuple(source for source in found if source is not None and source.image.shape == image.shape)
        return RecordedFrame(image, sparse_depth, intrinsics, truth, pose, sources)

    def _source(self, target: np.ndarray, intrinsics: np.ndarray, frame: FrameReference) -> SourceImage | None:
        pose = self._reader.pose(frame)
        if pose is None:
            return None
        motion = projecting_alike(source_from_target(target, pose), intrinsics, self._reader.intrinsics(frame))
        return SourceImage(self._image(frame), motion)

    def _image(self, frame: FrameReference) -> np.ndarray:
        """An image that is read once where it is a source frame soon after."""
        if not self._sources:
            return self._reader.image(frame)
        if frame not in self._images:
            self._images[frame] = self._reader.image(frame)
            if len(self._images) > _KEPT:
                self._images.popitem(last=False)
        return self._images[frame]
