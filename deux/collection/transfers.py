"""Arrays to and from the depth model's device, all in one transfer: each by itself would make the host wait."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

_ALIGNMENT = 16
"""Bytes that the place of an array in the transfer is a multiple of, so that any type of number may be read there."""


def upload(arrays: Sequence[np.ndarray], device: torch.device) -> list[Tensor]:
    """Copy arrays to a device; to a graphics card from pinned memory, without waiting for it.

    Args:
        arrays: of any shapes and types.
        device: where the tensors are to be; on the CPU they are copies, too.

    Returns:
        Tensors of the same shapes and types. They share their memory, but no part of it.
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
    """Copy tensors to the host; waits once.

    Args:
        tensors: on one device, float32.

    Returns:
        Arrays of the same shapes, each in memory of its own.
    """
    if not tensors:
        return []
    values = torch.cat([tensor.flatten() for tensor in tensors]).cpu().numpy()
    parts = np.split(values, np.cumsum([tensor.numel() for tensor in tensors])[:-1])
    return [part.reshape(tensor.shape).copy() for part, tensor in zip(parts, tensors, strict=True)]
