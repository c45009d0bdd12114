"""`training.compile`: networks and objective compiled by `torch.compile`, for as long as they train."""

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Literal

import torch
from torch import nn

from deux.errors import DeuxError

CompileMode = Literal["default", "reduce-overhead", "max-autotune"]
"""Modes of `torch.compile`; all but "default" replay what they compile as CUDA graphs of their own."""


@contextmanager
def compiled(networks: Sequence[nn.Module], mode: CompileMode | bool) -> Iterator[None]:
    """Compile networks in place for a while.

    In place means that names in their state dictionaries, and so in checkpoints and model files, stay as they are. The
    first step of each shape of batch compiles, which takes from seconds to minutes.

    Args:
        networks: each is compiled as a whole.
        mode: of `torch.compile`; True for "default", False to leave the networks alone.

    Raises:
        DeuxError: there is no compiler.
    """
    if mode is False:
        yield
        return
    _check_compiler()
    for network in networks:
        network.compile(mode="default" if mode is True else mode)
    try:
        yield
    finally:
        for network in networks:
            network._compiled_call_impl = None  # PyTorch has no call for the way back
        torch.compiler.reset()


def _check_compiler() -> None:
    """Raise DeuxError where nothing is installed that `torch.compile` could build its kernels with."""
    chosen = os.environ.get("CXX")
    if not any(shutil.which(name) for name in ([chosen] if chosen else ["g++", "clang++", "c++", "cl"])):
        missing = f"{chosen}, which CXX names," if chosen else "a C++ compiler"
        raise DeuxError(f"training.compile needs {missing} on the PATH: install g++, or set training.compile=false.")
