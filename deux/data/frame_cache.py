"""What is read of frames, and the cache of it in memory that the loader's processes share.

Depth is kept as it is stored in files, in 16 bits of metres x 256 (`deux.io.images`), wherever that loses nothing.
"""

from __future__ import annotations

import math
import mmap
import multiprocessing
from collections.abc import Collection, Iterable
from typing import Literal, NamedTuple

import numpy as np
from torch import Tensor

from deux.broken_contracts import broken_contract
from deux.contracts import FrameReference, Reader
from deux.errors import kind_of
from deux.io.images import DEPTH_SCALE, quantise_depth

Kind = Literal["image", "sparse_depth", "ground_truth"]
"""What pixels are read of a frame."""

_TYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))
"""Types of cached arrays: images, depth as it is stored, and other depth."""

_ALIGNMENT = 64


class FrameKey(NamedTuple):
    """One array of a frame.

    Args:
        reader: of the frame's dataset; readers that are equal share what is cached.
        kind: which array.
        frame: the frame.
    """

    reader: Reader
    kind: Kind
    frame: FrameReference


def read_frame_array(key: FrameKey) -> np.ndarray | None:
    """Read one array of a frame with its reader.

    Returns:
        An image as 3 x H x W uint8, depth as H x W float32 metres; None for ground truth that is not there.

    Raises:
        DeuxError: as the reader's methods; or what the reader gives is of another shape or type.
    """
    found: object = getattr(key.reader, key.kind)(key.frame)
    if found is None and key.kind == "ground_truth":
        return None
    is_image = key.kind == "image"
    if isinstance(found, np.ndarray) and found.dtype == (np.uint8 if is_image else np.float32):
        if is_image and found.ndim == 3 and found.shape[2] == 3:
            return np.ascontiguousarray(found.transpose(2, 0, 1))
        if not is_image and found.ndim == 2:
            return found
    wanted = "H x W x 3, uint8" if is_image else "H x W, float32, in metres"
    frame = f"frame {key.frame.name} of {key.frame.sequence} in {key.reader.folder}"
    raise broken_contract(key.reader, f"{kind_of(found)} for {frame}", f"an array of {wanted}", key.kind)


def compact(array: np.ndarray) -> np.ndarray:
    """Depth as uint16 multiples of 1/256 m if that gives back every bit of it; everything else as it is."""
    if array.dtype != np.float32:
        return array
    stored = quantise_depth(array)
    return (stored * np.float32(DEPTH_SCALE)).astype(np.uint16) if np.array_equal(stored, array) else array


def metres(stored: np.ndarray) -> np.ndarray:
    """A new array of float32 metres from what `compact` made of it."""
    depth = stored.astype(np.float32)
    if stored.dtype == np.uint16:
        depth *= np.float32(1.0 / DEPTH_SCALE)
    return depth


class FrameCache:
    """Keeps nothing: every array is read when it is asked for. The other caches derive from this one."""

    def read(self, key: FrameKey) -> np.ndarray | Tensor | None:
        """The array as `read_frame_array` or `compact` gives it; it is shared and must not be changed."""
        return read_frame_array(key)

    def reserve(self, keys: Collection[FrameKey], size: int) -> None:
        """Prepare for these arrays and forget all others.

        Args:
            keys: all arrays that will be read from now on.
            size: about as many bytes as the arrays that are not there yet will take.
        """

    def holds(self, key: FrameKey) -> bool:
        """Whether the array, once read, is or will be kept."""
        return False

    @property
    def size(self) -> int:
        """Bytes that are kept by now."""
        return 0


class MemoryCache(FrameCache):
    """Keeps arrays in memory that this process shares with those that it forks: each is decoded once by any of them.

    The memory is anonymous, so that `/dev/shm`, which containers keep small, does not bound it, and taken from the
    system as it is filled. A process that is started in another way than by a fork gets a cache without a place, which
    reads everything anew. Frames are read in random order, so what does not fit is not kept in place of anything else.

    Args:
        capacity: bound in bytes.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._places: dict[FrameKey, tuple[_Segment, int]] = {}

    def __reduce__(self) -> tuple[type[MemoryCache], tuple[int]]:
        return MemoryCache, (0,)

    def read(self, key: FrameKey) -> np.ndarray | Tensor | None:
        """The array as it was kept, or what is read now."""
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
        """Make places for the arrays that have none; the processes that read them are to be forked after this."""
        self._places = {key: self._places[key] for key in keys if key in self._places}
        taken = sum(segment.size for segment in self._segments)
        size = min(size + _ALIGNMENT * len(keys), self.capacity - taken)
        new = [key for key in keys if key not in self._places]
        if new and size > 0:
            segment = _Segment(len(new), size)
            self._places.update((key, (segment, row)) for row, key in enumerate(new))

    def holds(self, key: FrameKey) -> bool:
        """Whether there is a place for the array; it may turn out too small."""
        return key in self._places

    @property
    def size(self) -> int:
        """Bytes that are kept by now, by all processes."""
        return sum(segment.used for segment in self._segments)

    @property
    def _segments(self) -> list[_Segment]:
        return list({id(segment): segment for segment, _ in self._places.values()}.values())


class _Segment:
    """Arrays one after the other in shared memory, and a table that says where.

    Args:
        rows: number of arrays.
        size: bytes of all arrays together.
    """

    def __init__(self, rows: int, size: int) -> None:
        self.size = size
        self._lock = multiprocessing.get_context("fork").Lock()
        self._data = np.frombuffer(mmap.mmap(-1, size), np.uint8)
        table = np.frombuffer(mmap.mmap(-1, 8 * (1 + 5 * rows)), np.int64)
        self._end, self._table = table[:1], table[1:].reshape(rows, 5)  # end, type + 1, and up to three sides

    @property
    def used(self) -> int:
        """Bytes of the arrays that are there."""
        return int(self._end[0])

    def get(self, row: int) -> np.ndarray | None:
        """The array of a row, not to be written to; None if it has not been put there."""
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
        """Keep an array if there is room for it."""
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
    """About how many bytes these arrays take in a cache, judged by the first of each reader and kind.

    Args:
        keys: the arrays.
        known: bytes of one array of each reader and kind; what is not known yet is read and added.
    """
    total = 0
    for key in keys:
        group = key.reader, key.kind
        if group not in known:
            first = read_frame_array(key)
            known[group] = 0 if first is None else compact(first).nbytes
        total += known[group]
    return total
