"""Copies of several arrays to and from a device in one transfer, since each separate transfer makes the host wait."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

_ALIGNMENT = 16
"""Alignment of the arrays in the transfer, in bytes; enough for any dtype."""


def upload(arrays: Sequence[np.ndarray], device: torch.device) -> list[Tensor]:
    """Copy arrays to a device; to a GPU from pinned memory, without waiting for the copy.

    Args:
        arrays: arrays of any shapes and types.
        device: the device; on the CPU, the tensors are copies as well.

    Returns:
        Tensors of the same shapes and types: disjoint parts of one block of memory.
    """
    sizes = [-(-array.nbytes // _ALIGNMENT) * _ALIGNMENT for array in arrays]
    places = [sum(sizes[:number]) for number in range(len(sizes))]
    packed = torch.empty(sum(sizes), dtype=torch.uint8, pin_memory=device.type == "cuda")
    for array, place in zip(arrays, places, strict=True):
        there = packed.numpy()[place : place + array.nbytes]
        there.view(array.dtype).reshape(array.shape)[...] = array
    sent = packed.to(device, non_blocking=True)
    return [
        sent[place : place + array.nbytes].view(torch.from_numpy(np.empty(0, array.dtype)).dtype).view(array.shape)
        for array, place in zip(arrays, places, strict=True)
    ]


def download(tensors: Sequence[Tensor]) -> list[np.ndarray]:
    """Copy tensors to the host in one transfer.

    Args:
        tensors: float32, on one device.

    Returns:
        Arrays of the same shapes, which share no memory.
    """
    if not tensors:
        return []
    values = torch.cat([tensor.flatten() for tensor in tensors]).cpu().numpy()
    parts = np.split(values, np.cumsum([tensor.numel() for tensor in tensors])[:-1])
    return [part.reshape(tensor.shape).copy() for part, tensor in zip(parts, tensors, strict=True)]
