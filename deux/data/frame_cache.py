"""Reading of a frame's arrays, and the frame cache in memory that a data loader's processes share.

Depth is cached as in files, as uint16 in metres x 256 (`deux.io.images`), if that is lossless.
"""

from __future__ import annotations

import math
import mmap
import multiprocessing
from collections.abc import Collection, Iterable
from typing import Literal, NamedTuple

import numpy as np
from torch import Tensor

from deux.contracts import FrameReference, Reader
from deux.data.checked_frames import ground_truth_of, image_of, sparse_depth_of
from deux.io.images import DEPTH_SCALE, quantise_depth

Kind = Literal["image", "sparse_depth", "ground_truth"]
"""The arrays of a frame, named after the methods of `Reader`."""

_TYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))
"""Dtypes of cached arrays: images, depth in metres x 256, and depth in metres."""

_ALIGNMENT = 64


class FrameKey(NamedTuple):
    """One array of a frame.

    Args:
        reader: the reader of the frame; equal readers share cached arrays.
        kind: which array.
        frame: the frame.
    """

    reader: Reader
    kind: Kind
    frame: FrameReference


def read_frame_array(key: FrameKey) -> np.ndarray | None:
    """Read one array of a frame with its reader.

    Returns:
        An image as 3 x H x W uint8, depth as H x W float32 metres; None for ground truth that does not exist.

    Raises:
        DeuxError: as `deux.data.checked_frames`.
    """
    if key.kind == "image":
        return np.ascontiguousarray(image_of(key.reader, key.frame).transpose(2, 0, 1))
    return (sparse_depth_of if key.kind == "sparse_depth" else ground_truth_of)(key.reader, key.frame)


def compact(array: np.ndarray) -> np.ndarray:
    """Convert float32 depth to uint16 in metres x 256 if that is lossless; other arrays stay as they are."""
    if array.dtype != np.float32:
        return array
    stored = quantise_depth(array)
    return (stored * np.float32(DEPTH_SCALE)).astype(np.uint16) if np.array_equal(stored, array) else array


def metres(stored: np.ndarray) -> np.ndarray:
    """Convert the result of `compact` to a new array of float32 metres."""
    depth = stored.astype(np.float32)
    if stored.dtype == np.uint16:
        depth *= np.float32(1.0 / DEPTH_SCALE)
    return depth


class FrameCache:
    """A cache that stores nothing: every array is read when it is requested. The base class of the other caches."""

    def read(self, key: FrameKey) -> np.ndarray | Tensor | None:
        """The array, as returned by `read_frame_array` or `compact`; it is shared and must not be modified."""
        return read_frame_array(key)

    def reserve(self, keys: Collection[FrameKey], size: int) -> None:
        """Reserve space for these arrays and drop all others.

        Args:
            keys: all arrays that will be read from now on.
            size: estimated bytes of those that are not cached yet.
        """

    def holds(self, key: FrameKey) -> bool:
        """Whether the array is cached, or will be when it has been read."""
        return False

    @property
    def size(self) -> int:
        """Bytes of the cached arrays."""
        return 0


class MemoryCache(FrameCache):
    """Caches arrays in memory that is shared with forked processes: each array is decoded once, by any of them.

    The memory is an anonymous mapping, which is not limited by the small `/dev/shm` of containers and is allocated as
    it is filled. In a process that is not forked but spawned, the cache is empty and reads every array. Frames are read
    in random order, so arrays that do not fit never replace others.

    Args:
        capacity: capacity in bytes.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._places: dict[FrameKey, tuple[_Segment, int]] = {}

    def __reduce__(self) -> tuple[type[MemoryCache], tuple[int]]:
        return MemoryCache, (0,)

    def read(self, key: FrameKey) -> np.ndarray | Tensor | None:
        """The cached array; it is read and cached first if necessary."""
        place = self._places.get(key)
        if place is None:
            return read_frame_array(key)
        segment, row = place
        array = segment.get(row)
        if array is None:
            array = read_frame_array(key)
            if array is not None:
                segment.put(row, compact(array))
        return array

    def reserve(self, keys: Collection[FrameKey], size: int) -> None:
        """Reserve space for new arrays, to be called before worker processes are forked."""
        self._places = {key: self._places[key] for key in keys if key in self._places}
        taken = sum(segment.size for segment in self._segments)
        size = min(size + _ALIGNMENT * len(keys), self.capacity - taken)
        new = [key for key in keys if key not in self._places]
        if new and size > 0:
            segment = _Segment(len(new), size)
            self._places.update((key, (segment, row)) for row, key in enumerate(new))

    def holds(self, key: FrameKey) -> bool:
        """Whether a place is reserved for the array; its segment may turn out too small."""
        return key in self._places

    @property
    def size(self) -> int:
        """Bytes of the arrays that all processes have cached."""
        return sum(segment.used for segment in self._segments)

    @property
    def _segments(self) -> list[_Segment]:
        return list({id(segment): segment for segment, _ in self._places.values()}.values())


class _Segment:
    """A shared memory mapping of consecutive arrays, with a table of their positions.

    Args:
        rows: number of arrays.
        size: capacity in bytes.
    """

    def __init__(self, rows: int, size: int) -> None:
        self.size = size
        self._lock = multiprocessing.get_context("fork").Lock()
        self._data = np.frombuffer(mmap.mmap(-1, size), np.uint8)
        table = np.frombuffer(mmap.mmap(-1, 8 * (1 + 5 * rows)), np.int64)
        self._end, self._table = table[:1], table[1:].reshape(rows, 5)  # end, dtype + 1 (0: empty), three sides

    @property
    def used(self) -> int:
        """Bytes in use."""
        return int(self._end[0])

    def get(self, row: int) -> np.ndarray | None:
        """The read-only array of a row; None if the row is empty."""
        with self._lock:
            end, number, *sides = self._table[row].tolist()
        if number == 0:
            return None
        dtype, shape = _TYPES[number - 1], [side for side in sides if side]
        begin = end - math.prod(shape) * dtype.itemsize
        array = self._data[begin:end].view(dtype).reshape(shape)
        array.flags.writeable = False
        return array

    def put(self, row: int, array: np.ndarray) -> None:
        """Store an array if it fits."""
        with self._lock:
            begin = -(-self.used // _ALIGNMENT) * _ALIGNMENT
            end = begin + array.nbytes
            if self._table[row, 1] or end > self.size or 0 in array.shape:
                return
            self._data[begin:end] = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
            sides = [0] * (3 - array.ndim) + [*array.shape]
            self._table[row] = end, _TYPES.index(array.dtype) + 1, *sides
            self._end[0] = end


def stored_bytes(keys: Iterable[FrameKey], known: dict[tuple[Reader, Kind], int]) -> int:
    """Estimate the bytes that arrays take in a cache, from the first array of each reader and kind.

    Args:
        keys: the arrays.
        known: bytes of one array of each reader and kind; missing entries are measured and added.
    """
    total = 0
    for key in keys:
        group = key.reader, key.kind
        if group not in known:
            first = read_frame_array(key)
            known[group] = 0 if first is None else compact(first).nbytes
        total += known[group]
    return total
