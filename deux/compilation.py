"""Functions compiled by numba, with the machine code kept on disk where that is possible."""

import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

_kept: list[Any] = []
"""The functions that this process has imported and whose machine code is kept on disk."""


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function when it is first called; a decorator, with or without options of `numba.njit`.

    The machine code is kept beside the module, in the user's cache or in NUMBA_CACHE_DIR. Where none of them can be
    written, as in a read-only installation, each process compiles anew, which a warning says.
    """
    if function is None:
        return lambda decorated: compiled(decorated, **options)
    try:
        dispatcher = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder for its cache
        _warn_once()
        return njit(**options)(function)
    _kept.append(dispatcher)
    return dispatcher


@functools.cache
def _warn_once() -> None:
    warnings.warn(
        "compiled code cannot be kept: the installation and the home folder are read-only, so every start takes "
        "some seconds longer; set NUMBA_CACHE_DIR to a folder that can be written.",
        stacklevel=3,
    )


def nothing_compiled() -> bool:
    """Whether no machine code is kept yet of any function imported so far, so that the first calls take many seconds.

    Only the names of files are looked at: code of an older version of a function counts as kept.
    """
    return bool(_kept) and not any(
        any(Path(dispatcher.stats.cache_path).glob(f"*{dispatcher.py_func.__qualname__}-*.nbi")) for dispatcher in _kept
    )


def kept_folders() -> list[Path]:
    """The folders in which machine code is kept, of the functions imported so far."""
    return sorted({Path(dispatcher.stats.cache_path).resolve() for dispatcher in _kept})
