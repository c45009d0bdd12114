"""The frame cache on the training device: images as uint8 and depth as uint16, with one tensor for each size."""

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
    """The dtype to index a tensor with: int16 for uint16, which torch before 2.10 and GPUs cannot index."""
    return torch.int16 if dtype == torch.uint16 else dtype


class FrameStack:
    """Arrays of one dtype and size in one tensor, so that one operation can crop many of them.

    Args:
        like: one of the arrays, C x H x W or H x W, as returned by `compact`.
        device: the device of the tensor.
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
        """Number of channels of one array: 3 for images, 1 for depth maps."""
        return math.prod(self._shape[:-2])

    @property
    def rows(self) -> int:
        """Capacity: the number of arrays."""
        return len(self.planes) // self.channels

    def grow(self, rows: int) -> None:
        """Increase the capacity by a number of arrays; this copies the existing arrays."""
        self.free += range(self.rows, self.rows + rows)
        planes = self.planes.new_empty((len(self.planes) + rows * self.channels, *self.size))
        planes[: len(self.planes)].copy_(self.planes)
        self.planes = planes

    def put(self, row: int, array: np.ndarray) -> None:
        """Copy an array to a row; the host does not wait for the copy."""
        tensor = torch.from_numpy(array).view(self.planes.dtype).view(self.channels, *self.size)
        self.planes[row * self.channels : (row + 1) * self.channels].copy_(to_device(tensor, self.planes.device))

    def get(self, row: int) -> Tensor:
        """The array of a row; it must not be modified."""
        return self.planes[row * self.channels : (row + 1) * self.channels].view(self._type).view(self._shape)

    def cut(self, planes: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """Crop M arrays: M x C x h x w.

        Args:
            planes: M x C x 1 x 1 int64, indices of the arrays' channels in `self.planes`.
            rows: M x 1 x h x 1 int64, consecutive rows of each window, increasing or decreasing.
            columns: M x 1 x 1 x w int64, consecutive columns of each window, increasing or decreasing.
        """
        cut = cut_on_cpu if self.planes.device.type == "cpu" else cut_on_device
        windows = cut(self.planes, planes, rows, columns)
        return windows if windows.dtype == self._type else windows.view(self._type)


class StoredFrame(NamedTuple):
    """The location of an array in the cache.

    Args:
        stack: the stack that holds it.
        row: its row in the stack.
        points: the points of a sparse depth map; None for other arrays.
    """

    stack: FrameStack
    row: int
    points: "HostPoints | None"

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.stack.size


class HostPoints(NamedTuple):
    """The points of a sparse depth map on the host, which need not be copied from the device.

    Args:
        pixels: N int32, increasing indices of the map's H W pixels.
        depth: N float32, metres.
    """

    pixels: np.ndarray
    depth: np.ndarray

    @classmethod
    def of(cls, depth: np.ndarray) -> "HostPoints":
        """The points of a map, H x W float32 metres."""
        pixels = np.flatnonzero(depth).astype(np.int32)
        return cls(pixels, depth.flat[pixels])


class DeviceCache(FrameCache):
    """Caches arrays on a device, for as long as their readers are in use.

    Args:
        device: the device.
        capacity: capacity in bytes; arrays that do not fit are read and copied each time.
    """

    def __init__(self, device: torch.device, capacity: int) -> None:
        self.device, self.capacity = device, capacity
        self._stacks: dict[tuple[object, ...], FrameStack] = {}
        self._stored: dict[FrameKey, StoredFrame] = {}
        self._wanted: set[FrameKey] = set()

    @property
    def size(self) -> int:
        """Allocated bytes."""
        return sum(stack.planes.nbytes for stack in self._stacks.values())

    def read(self, key: FrameKey) -> np.ndarray | Tensor | None:
        """The array as a tensor on the device."""
        found = self.load([key])[0]
        return None if found is None else found.stack.get(found.row)

    def load(self, keys: Sequence[FrameKey]) -> list[StoredFrame | None]:
        """Locate arrays in the cache; missing ones are read in parallel threads and added.

        Returns:
            The location of each array; None for ground truth that a dataset does not have.
        """
        stored: dict[FrameKey, StoredFrame | None] = {key: self._stored.get(key) for key in keys}
        missing = [key for key, found in stored.items() if found is None]
        if missing:
            with ThreadPoolExecutor(min(len(missing), os.cpu_count() or 1)) as threads:
                arrays = list(threads.map(read_frame_array, missing))
            for key, array in zip(missing, arrays, strict=True):  # in this thread, which has the right current device
                stored[key] = None if array is None else self._store(key, array)
        return [stored[key] for key in keys]

    def reserve(self, keys: Collection[FrameKey], size: int) -> None:
        """Drop all other arrays from the cache."""
        self._wanted = set(keys)
        for key in [key for key in self._stored if key not in self._wanted]:
            stack, row, _ = self._stored.pop(key)
            stack.free.append(row)
        self._stacks = {name: stack for name, stack in self._stacks.items() if len(stack.free) < stack.rows}

    def holds(self, key: FrameKey) -> bool:
        """Whether the array is in the cache."""
        return key in self._stored

    def _store(self, key: FrameKey, array: np.ndarray) -> StoredFrame:
        """Copy an array to the device, into the cache if there is room."""
        points = HostPoints.of(array) if key.kind == "sparse_depth" else None
        array = np.ascontiguousarray(compact(array))
        name = array.dtype, array.shape
        stack = self._stacks.get(name) or FrameStack(array, self.device)
        if not stack.free and (rows := self._new_rows(key, stack, array.nbytes)):
            stack.grow(rows)
        if not stack.free:  # the cache is full: use a separate tensor
            alone = FrameStack(array, self.device)
            alone.grow(1)
            alone.put(0, array)
            return StoredFrame(alone, 0, points)
        self._stacks[name] = stack
        stored = self._stored[key] = StoredFrame(stack, stack.free.pop(), points)
        stack.put(stored.row, array)
        return stored

    def _new_rows(self, key: FrameKey, stack: FrameStack, size: int) -> int:
        """Number of rows by which to grow a stack of arrays of `size` bytes: enough for all of the reader and kind."""
        room = max(0, self.capacity - self.size) // max(1, size)
        if room == 0:
            return 0
        alike = sum(other[:2] == key[:2] and other not in self._stored for other in self._wanted)
        return min(room, alike or max(1, stack.rows))


class Shipment:
    """Arrays of int64 and float32 that are copied to a device together."""

    def __init__(self) -> None:
        self._arrays: list[np.ndarray] = []

    def add(self, array: np.ndarray) -> int:
        """Add an array; returns its position in the list that `send` returns."""
        self._arrays.append(array)
        return len(self._arrays) - 1

    def send(self, device: torch.device) -> list[Tensor]:
        """Copy the arrays to a device; the host does not wait for the copy. The tensors are views of one buffer."""
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
    """Crop windows in one indexing operation; see `FrameStack.cut`."""
    return frames[planes, rows, columns]


def cut_on_cpu(frames: Tensor, planes: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Crop windows by slices, which on the CPU is ten times faster than indexing; see `FrameStack.cut`."""
    source, windows = frames.numpy(), []
    indices = planes[:, :, 0, 0].numpy(), rows[:, 0, :, 0].numpy(), columns[:, 0, 0].numpy()
    for plane, row, column in zip(*indices, strict=True):
        (top, bottom), (left, right) = sorted((row[0], row[-1])), sorted((column[0], column[-1]))
        window = source[plane[0] : plane[-1] + 1, top : bottom + 1, left : right + 1]
        windows.append(window[:, :: 1 if row[0] == top else -1, :: 1 if column[0] == left else -1])
    return torch.from_numpy(np.stack(windows))


def to_device(tensor: Tensor, device: torch.device) -> Tensor:
    """Copy a host tensor to a device; the host does not wait for the copy."""
    if device.type != "cuda":
        return tensor.to(device)
    return tensor.pin_memory().to(device, non_blocking=True)


def metres_on_device(stored: Tensor) -> Tensor:
    """Convert cached depth to float32 metres on its device, bit by bit equal to `deux.data.frame_cache.metres`."""
    depth = stored.to(torch.float32, copy=True)
    return depth.mul_(1.0 / DEPTH_SCALE) if stored.dtype == torch.uint16 else depth


def colors(images: Tensor, white: Tensor) -> Tensor:
    """Convert images to float32: uint8 is divided by 255, floats stay as they are.

    Args:
        images: images of any shape.
        white: the tensor 255 on their device. Torch would multiply by the inverse of a Python number, which may differ
            in the last bit.
    """
    return images / white if images.dtype == torch.uint8 else images
