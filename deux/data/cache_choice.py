"""Where the frames of a data set are kept while a model trains on them: on the device, in memory, or nowhere."""

import os
from collections.abc import Callable
from typing import Literal, NamedTuple, get_args

import torch

from deux.contracts import DepthModel
from deux.errors import DeuxError, near_matches
from deux.memory_budget import free_memory

CacheChoice = Literal["auto", "device", "memory", "none"]
"""`data.cache`: keep the frames on the device that trains, in memory, or read them each time; "auto" goes by size."""

SHARE = 0.5
"""Part of what is free, on the card or in memory, that frames may take; the rest is the model's and the system's."""


def cache_choice(value: object) -> CacheChoice:
    """The value of `data.cache`.

    Raises:
        DeuxError: it is none of the choices.
    """
    for choice in get_args(CacheChoice):
        if value == choice:
            return choice
    raise DeuxError(f"data.cache is {value!r}: {near_matches(str(value), get_args(CacheChoice))}")


class Placement(NamedTuple):
    """Where the frames of a loader are kept, and who prepares its batches.

    Args:
        cache: "device", "memory" or "none".
        num_workers: processes that prepare batches.
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
    """Decide where frames are kept.

    Args:
        choice: what the user asks for.
        size: bytes of all frames.
        device: the device that trains.
        room_on_device: bytes that they may take there.
        room_in_memory: bytes that they may take in this process's part of the memory.
        num_workers: processes that prepare batches, if the user says so.
        processes: that train together on this machine and share its cores.
        agree: makes one decision of those of all processes that train together.

    Returns:
        For "auto", a card if the frames fit there, else memory, which for training on the CPU is as fast as the device
        cache. By default no worker processes where everything is at hand on the device that trains; else as many as
        this process has cores for beside its own, no more than eight.
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
    """Whether the model computes further inputs on the CPU from the points that are shown to it."""
    return type(model).prepare is not DepthModel.prepare


def free_on_device(device: torch.device) -> int:
    """Bytes that are free on a card, those that torch has reserved and does not use included; of the CPU, in memory."""
    if device.type != "cuda":
        return free_memory()
    unused = torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    return torch.cuda.mem_get_info(device)[0] + unused
