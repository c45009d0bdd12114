"""Compilation of functions by numba, with a cache of the machine code on disk if possible."""

import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

_cached: list[Any] = []
"""Imported functions whose machine code is cached on disk."""


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Decorator that compiles a function at its first call, with or without options of `numba.njit`.

    The machine code is cached in NUMBA_CACHE_DIR, next to the module or in the user's cache folder. If none of these is
    writable, a warning is issued, and each process compiles the function again.
    """
    if function is None:
        return lambda decorated: compiled(decorated, **options)
    try:
        dispatcher = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no writable folder for its cache
        _warn_about_cache()
        return njit(**options)(function)
    _cached.append(dispatcher)
    return dispatcher


@functools.cache
def _warn_about_cache() -> None:
    warnings.warn(
        "compiled code cannot be cached, since the installation and the home folder are read-only, so every start "
        "takes some seconds longer: set NUMBA_CACHE_DIR to a writable folder.",
        stacklevel=3,
    )


def nothing_compiled() -> bool:
    """Whether no imported function has cached machine code, so that the first calls take many seconds.

    Only file names are compared: machine code of an older version of a function counts as cached.
    """
    return bool(_cached) and not any(
        any(Path(function.stats.cache_path).glob(f"*{function.py_func.__qualname__}-*.nbi")) for function in _cached
    )


def cache_folders() -> list[Path]:
    """The folders with cached machine code of the imported functions."""
    return sorted({Path(function.stats.cache_path).resolve() for function in _cached})
