"""`training.compile`: networks and objective are compiled by `torch.compile` during training."""

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Literal

import torch
from torch import nn

from deux.errors import DeuxError

CompileMode = Literal["default", "reduce-overhead", "max-autotune"]
"""Modes of `torch.compile`; all but "default" use CUDA graphs."""


@contextmanager
def compiled_networks(networks: Sequence[nn.Module], mode: CompileMode | bool) -> Iterator[None]:
    """Compile networks in place, within this context.

    Compiling in place keeps the names of parameters in checkpoints and model files. The first step of each shape of
    batch compiles, which takes seconds to minutes.

    Args:
        networks: each is compiled as a whole.
        mode: mode of `torch.compile`; True for "default", False for no compilation.

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
            network._compiled_call_impl = None  # PyTorch has no public function that undoes compile()
        torch.compiler.reset()


def _check_compiler() -> None:
    """Raise DeuxError unless a C++ compiler is installed, which `torch.compile` needs to build kernels."""
    chosen = os.environ.get("CXX")
    if not any(shutil.which(name) for name in ([chosen] if chosen else ["g++", "clang++", "c++", "cl"])):
        missing = f"{chosen}, which CXX names," if chosen else "a C++ compiler"
        raise DeuxError(f"training.compile needs {missing} on the PATH: install g++, or set training.compile=false.")
