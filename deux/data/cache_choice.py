"""Choice of the frame cache: on the training device, in memory, or none."""

import os
from collections.abc import Callable
from typing import Literal, NamedTuple, get_args

import torch

from deux.contracts import DepthModel
from deux.errors import DeuxError, near_matches
from deux.memory_budget import free_memory

CacheChoice = Literal["auto", "device", "memory", "none"]
"""Values of `data.cache`: cache frames on the training device, in memory, or not at all; "auto" decides by size."""

SHARE = 0.5
"""Fraction of the free memory, on the GPU or the host, that cached frames may take."""


def cache_choice(value: object) -> CacheChoice:
    """Check the value of `data.cache`.

    Raises:
        DeuxError: there is no such choice.
    """
    for choice in get_args(CacheChoice):
        if value == choice:
            return choice
    raise DeuxError(f"data.cache is {value!r}: {near_matches(str(value), get_args(CacheChoice))}")


class Placement(NamedTuple):
    """Where the frames of a data loader are cached, and its number of workers.

    Args:
        cache: "device", "memory" or "none".
        num_workers: worker processes that prepare batches.
    """

    cache: Literal["device", "memory", "none"]
    num_workers: int


def place(
    choice: CacheChoice,
    size: int,
    device: torch.device,
    room_on_device: int,
    room_in_memory: int,
    num_workers: int | None,
    processes: int = 1,
    agree: Callable[[bool], bool] = bool,
) -> Placement:
    """Decide where frames are cached.

    Args:
        choice: the value of `data.cache`.
        size: bytes of all frames.
        device: the training device.
        room_on_device: bytes that the frames may take on the device.
        room_in_memory: bytes that the frames of this process may take in memory.
        num_workers: worker processes; None for the default.
        processes: training processes on this machine, which share its cores.
        agree: reduces the decisions of all training processes to one.

    Returns:
        For "auto" a GPU if the frames fit there, otherwise memory, which for training on the CPU is as fast as the
        device cache. By default there are no worker processes if all frames are cached on the training device, and
        otherwise one per core besides the one of this process, at most eight.
    """
    fits_device, fits_memory = agree(size <= room_on_device), agree(size <= room_in_memory)
    if choice == "device" or (choice == "auto" and device.type != "cpu" and fits_device):
        return Placement("device", 0)
    cache: Literal["memory", "none"] = "none" if choice == "none" else "memory"
    at_hand = cache == "memory" and fits_memory and device.type == "cpu"
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = 0 if at_hand else max(1, min(8, cores // processes - 1))
    return Placement(cache, workers if num_workers is None else num_workers)


def prepares_on_host(model: DepthModel) -> bool:
    """Whether the model computes further inputs on the CPU from the input sparse depth (`DepthModel.prepare`)."""
    return type(model).prepare is not DepthModel.prepare


def free_on_device(device: torch.device) -> int:
    """Free bytes on a GPU, including those that torch has reserved but does not use; for the CPU, in memory."""
    if device.type != "cuda":
        return free_memory()
    unused = torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    return torch.cuda.mem_get_info(device)[0] + unused
