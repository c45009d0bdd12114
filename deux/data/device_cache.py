"""The cache of frames on the device that trains: images as uint8 and depth as uint16 tensors."""

import os
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from torch import Tensor

from deux.data.frame_cache import FrameCache, FrameKey, compact, read_frame
from deux.io.images import DEPTH_SCALE


class DeviceCache(FrameCache):
    """Keeps every array as a tensor on a device, for as long as its readers are in use.

    Args:
        device: where the tensors lie.
        capacity: bound in bytes; what does not fit is read and copied each time.
    """

    def __init__(self, device: torch.device, capacity: int) -> None:
        self.device, self.capacity = device, capacity
        self._tensors: dict[FrameKey, Tensor] = {}
        self._points: dict[FrameKey, np.ndarray] = {}
        self._size = 0

    @property
    def size(self) -> int:
        """Bytes that are held."""
        return self._size

    def read(self, key: FrameKey) -> np.ndarray | Tensor | None:
        """The array as a tensor on the device."""
        if key in self._tensors:
            return self._tensors[key]
        array = read_frame(key)
        return None if array is None else self._keep(key, array)

    def read_together(self, keys: Collection[FrameKey]) -> None:
        """Read those of the arrays that are not there yet, in threads: files are decoded on all cores."""
        missing = [key for key in dict.fromkeys(keys) if key not in self._tensors]
        if len(missing) < 2 or self._size >= self.capacity:
            return
        with ThreadPoolExecutor(min(len(missing), os.cpu_count() or 1)) as threads:
            arrays = list(threads.map(read_frame, missing))
        for key, array in zip(missing, arrays, strict=True):  # in this thread, whose device is the right one
            if array is not None:
                self._keep(key, array)

    def points_within(self, key: FrameKey, top: int, left: int, height: int, width: int) -> int | None:
        """How many points a part of a sparse depth map has, counted on the host; None if the map is not kept."""
        if key not in self._points:
            return None
        rows, columns = np.divmod(self._points[key], self._tensors[key].shape[1])
        inside = (rows >= top) & (rows < top + height) & (columns >= left) & (columns < left + width)
        return int(np.count_nonzero(inside))

    def reserve(self, keys: Collection[FrameKey], size: int) -> None:
        """Forget all other arrays."""
        wanted = set(keys)
        for key in [key for key in self._tensors if key not in wanted]:
            self._size -= self._tensors.pop(key).nbytes
            self._points.pop(key, None)

    def holds(self, key: FrameKey) -> bool:
        """Whether the array is there."""
        return key in self._tensors

    def _keep(self, key: FrameKey, array: np.ndarray) -> Tensor:
        stored = compact(array)
        tensor = upload(torch.from_numpy(stored), self.device)
        if self._size + tensor.nbytes <= self.capacity:
            self._size += tensor.nbytes
            self._tensors[key] = tensor
            if key.kind == "sparse_depth":
                self._points[key] = np.flatnonzero(array).astype(np.int32)
        return tensor


def upload(tensor: Tensor, device: torch.device) -> Tensor:
    """A tensor of the host on the device; the host does not wait for the copy."""
    if device.type != "cuda":
        return tensor.to(device)
    return tensor.pin_memory().to(device, non_blocking=True)


def metres_on_device(stored: Tensor) -> Tensor:
    """As `deux.data.frame_cache.metres`, on the tensor's device, and equal to it in every bit."""
    depth = stored.to(torch.float32, copy=True)
    return depth.mul_(1.0 / DEPTH_SCALE) if stored.dtype == torch.uint16 else depth


def colors(images: Sequence[Tensor]) -> Tensor:
    """Images of equal size as one batch in float32: bytes divided by 255, other values as they are."""
    if any(image.dtype != torch.uint8 for image in images):
        return torch.stack([_color(image) for image in images])
    return _color(torch.stack(list(images)))


def _color(image: Tensor) -> Tensor:
    if image.dtype != torch.uint8:
        return image
    # On a card, torch multiplies by the inverse of a number, which may lose a bit, and divides by a tensor.
    return image.to(torch.float32).div_(torch.full((), 255.0, device=image.device))
