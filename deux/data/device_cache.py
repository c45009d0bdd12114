"""The cache of frames on the device that trains: images as uint8 and depth as uint16, all of one size in one tensor."""

import math
import os
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from deux.data.frame_cache import FrameCache, FrameKey, compact, read_frame_array
from deux.io.images import DEPTH_SCALE


def indexable(dtype: torch.dtype) -> torch.dtype:
    """The type as which a tensor is indexed: torch before 2.10 and cards index no uint16; int16 has the same bits."""
    return torch.int16 if dtype == torch.uint16 else dtype


class FrameStack:
    """Arrays of one type and size in one tensor, so that one operation cuts parts out of many of them.

    Args:
        like: one of the arrays, C x H x W or H x W, as `compact` gives it.
        device: where the tensor lies.
    """

    def __init__(self, like: np.ndarray, device: torch.device) -> None:
        self._shape = like.shape
        self._type = torch.from_numpy(like[:0]).dtype
        self.planes = torch.empty((0, *self.size), dtype=indexable(self._type), device=device)
        self.free: list[int] = []

    @property
    def size(self) -> tuple[int, int]:
        """Height and width."""
        return self._shape[-2], self._shape[-1]

    @property
    def channels(self) -> int:
        """Planes of one array: 3 of an image, 1 of a depth map."""
        return math.prod(self._shape[:-2])

    @property
    def rows(self) -> int:
        """Number of arrays that there is room for."""
        return len(self.planes) // self.channels

    def grow(self, rows: int) -> None:
        """Make room for so many further arrays; those that are there are copied."""
        self.free += range(self.rows, self.rows + rows)
        planes = self.planes.new_empty((len(self.planes) + rows * self.channels, *self.size))
        planes[: len(self.planes)].copy_(self.planes)
        self.planes = planes

    def put(self, row: int, array: np.ndarray) -> None:
        """Copy an array to its row; the host does not wait for it."""
        tensor = torch.from_numpy(array).view(self.planes.dtype).view(self.channels, *self.size)
        self.planes[row * self.channels : (row + 1) * self.channels].copy_(to_device(tensor, self.planes.device))

    def get(self, row: int) -> Tensor:
        """The array of a row, not to be written to."""
        return self.planes[row * self.channels : (row + 1) * self.channels].view(self._type).view(self._shape)

    def cut(self, planes: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """A window of each of M arrays: M x C x h x w.

        Args:
            planes: M x C x 1 x 1 int64, the numbers of their planes.
            rows: M x 1 x h x 1 int64, of the windows, rising or falling by one.
            columns: M x 1 x 1 x w int64, as well.
        """
        cut = cut_on_cpu if self.planes.device.type == "cpu" else cut_on_device
        found = cut(self.planes, planes, rows, columns)
        return found if found.dtype == self._type else found.view(self._type)


class StoredFrame(NamedTuple):
    """Where an array lies.

    Args:
        stack: the tensor.
        row: the array's place in it.
        points: of a sparse depth map, its points; else None.
    """

    stack: FrameStack
    row: int
    points: "HostPoints | None"

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.stack.size


class HostPoints(NamedTuple):
    """The points of a sparse depth map, on the host, which does not have to ask the device for them.

    Args:
        pixels: increasing indices of the map's H W pixels.
        depth: of each, float32 metres.
    """

    pixels: np.ndarray
    depth: np.ndarray

    @classmethod
    def of(cls, depth: np.ndarray) -> "HostPoints":
        """The points of a map, H x W float32 metres."""
        pixels = np.flatnonzero(depth).astype(np.int32)
        return cls(pixels, depth.flat[pixels])


class DeviceCache(FrameCache):
    """Keeps every array on a device, for as long as its readers are in use.

    Args:
        device: where the tensors lie.
        capacity: bound in bytes; what does not fit is read and copied each time.
    """

    def __init__(self, device: torch.device, capacity: int) -> None:
        self.device, self.capacity = device, capacity
        self._stacks: dict[tuple[object, ...], FrameStack] = {}
        self._stored: dict[FrameKey, StoredFrame] = {}
        self._wanted: set[FrameKey] = set()

    @property
    def size(self) -> int:
        """Bytes that are taken."""
        return sum(stack.planes.nbytes for stack in self._stacks.values())

    def read(self, key: FrameKey) -> np.ndarray | Tensor | None:
        """The array as a tensor on the device."""
        found = self.load([key])[0]
        return None if found is None else found.stack.get(found.row)

    def load(self, keys: Sequence[FrameKey]) -> list[StoredFrame | None]:
        """Where each array lies, read in threads if it is not there yet, so that files are decoded on all cores.

        Returns:
            None for ground truth that a dataset does not have.
        """
        stored: dict[FrameKey, StoredFrame | None] = {key: self._stored.get(key) for key in keys}
        missing = [key for key, found in stored.items() if found is None]
        if missing:
            with ThreadPoolExecutor(min(len(missing), os.cpu_count() or 1)) as threads:
                arrays = list(threads.map(read_frame_array, missing))
            for key, array in zip(missing, arrays, strict=True):  # in this thread, whose device is the right one
                stored[key] = None if array is None else self._store(key, array)
        return [stored[key] for key in keys]

    def reserve(self, keys: Collection[FrameKey], size: int) -> None:
        """Forget all other arrays."""
        self._wanted = set(keys)
        for key in [key for key in self._stored if key not in self._wanted]:
            stack, row, _ = self._stored.pop(key)
            stack.free.append(row)
        self._stacks = {name: stack for name, stack in self._stacks.items() if len(stack.free) < stack.rows}

    def holds(self, key: FrameKey) -> bool:
        """Whether the array is there."""
        return key in self._stored

    def _store(self, key: FrameKey, array: np.ndarray) -> StoredFrame:
        """Copy an array to the device, and keep it if there is room."""
        points = HostPoints.of(array) if key.kind == "sparse_depth" else None
        array = np.ascontiguousarray(compact(array))
        name = array.dtype, array.shape
        stack = self._stacks.get(name) or FrameStack(array, self.device)
        if not stack.free and (rows := self._new_rows(key, stack, array.nbytes)):
            stack.grow(rows)
        if not stack.free:  # beside what is kept: a tensor of its own
            alone = FrameStack(array, self.device)
            alone.grow(1)
            alone.put(0, array)
            return StoredFrame(alone, 0, points)
        self._stacks[name] = stack
        stored = self._stored[key] = StoredFrame(stack, stack.free.pop(), points)
        stack.put(stored.row, array)
        return stored

    def _new_rows(self, key: FrameKey, stack: FrameStack, size: int) -> int:
        """By how many arrays of `size` bytes a stack is to grow: once for all of the same reader and kind."""
        room = max(0, self.capacity - self.size) // max(1, size)
        if room == 0:
            return 0
        alike = sum(other[:2] == key[:2] and other not in self._stored for other in self._wanted)
        return min(room, alike or max(1, stack.rows))


class Shipment:
    """Arrays of int64 and float32 that go to a device in one copy."""

    def __init__(self) -> None:
        self._arrays: list[np.ndarray] = []

    def add(self, array: np.ndarray) -> int:
        """The number under which an array will be found in what `send` returns."""
        self._arrays.append(array)
        return len(self._arrays) - 1

    def send(self, device: torch.device) -> list[Tensor]:
        """The arrays as tensors, views of one; the host does not wait for them."""
        words = [-(-array.nbytes // 8) for array in self._arrays]
        begins = np.cumsum([0, *words]).tolist()
        packed = np.zeros(begins[-1], np.int64)
        for array, begin in zip(self._arrays, begins, strict=False):
            packed[begin:].view(array.dtype)[: array.size] = array.ravel()
        integers = to_device(torch.from_numpy(packed), device)
        whole = {np.dtype(np.int64): integers, np.dtype(np.float32): integers.view(torch.float32)}
        sent = []
        for array, begin in zip(self._arrays, begins, strict=False):
            strides = [stride // array.itemsize for stride in np.empty(array.shape, array.dtype).strides]
            start = begin * packed.itemsize // array.itemsize
            sent.append(whole[array.dtype].as_strided(array.shape, strides, start))
        return sent


def cut_on_device(frames: Tensor, planes: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Windows of planes in one operation, as `FrameStack.cut` describes them."""
    return frames[planes, rows, columns]


def cut_on_cpu(frames: Tensor, planes: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """The same on the CPU, where slices are copied ten times faster than single pixels."""
    source, found = frames.numpy(), []
    indices = planes[:, :, 0, 0].numpy(), rows[:, 0, :, 0].numpy(), columns[:, 0, 0].numpy()
    for plane, row, column in zip(*indices, strict=True):
        (top, bottom), (left, right) = sorted((row[0], row[-1])), sorted((column[0], column[-1]))
        window = source[plane[0] : plane[-1] + 1, top : bottom + 1, left : right + 1]
        found.append(window[:, :: 1 if row[0] == top else -1, :: 1 if column[0] == left else -1])
    return torch.from_numpy(np.stack(found))


def to_device(tensor: Tensor, device: torch.device) -> Tensor:
    """A tensor of the host on the device; the host does not wait for the copy."""
    if device.type != "cuda":
        return tensor.to(device)
    return tensor.pin_memory().to(device, non_blocking=True)


def metres_on_device(stored: Tensor) -> Tensor:
    """As `deux.data.frame_cache.metres`, on the tensor's device, and equal to it in every bit."""
    depth = stored.to(torch.float32, copy=True)
    return depth.mul_(1.0 / DEPTH_SCALE) if stored.dtype == torch.uint16 else depth


def colors(images: Tensor, white: Tensor) -> Tensor:
    """Images in float32: bytes divided by 255, other values as they are.

    Args:
        images: of any shape.
        white: 255, a tensor on their device: torch multiplies by the inverse of a number there, which may lose a bit.
    """
    return images / white if images.dtype == torch.uint8 else images
