"""Atomic writing of files, and reading of whole files."""

import codecs
import errno
import json
import math
import os
import shutil
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any

from deux.errors import DeuxError
from deux.memory_budget import check_memory


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file under a temporary name in the same folder, then rename it.

    The temporary name depends only on the path, so that the next run overwrites the leftovers of a killed run. Only one
    process at a time may write a file.

    Raises:
        DeuxError: the file cannot be written, for example because the disk is full.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    except OSError as error:
        with suppress(OSError):  # deleting may fail for the same reason
            temporary.unlink()
        raise DeuxError(write_failure(path, error, len(content))) from error


def make_folder(path: Path) -> None:
    """Create a folder and its parents if they do not exist.

    Raises:
        DeuxError: it cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DeuxError(f"Folder {path} cannot be created: {error.strerror}.") from error


def write_json(path: Path, value: Any) -> None:
    """Write a value as indented JSON, atomically."""
    write_atomically(path, (json.dumps(value, indent=2) + "\n").encode())


def read_bytes(path: Path) -> bytes:
    """Read a whole file.

    Raises:
        DeuxError: the file is missing, cannot be read, is too large for the memory, or is a pipe or a device, which
            might block forever.
    """
    try:
        with open(path, "rb", opener=_open_at_once) as file:
            state = os.fstat(file.fileno())
            if not stat.S_ISREG(state.st_mode):
                raise DeuxError(f"{path} cannot be read: it is a pipe or a device where a file is expected.")
            check_memory(2 * state.st_size, f"{path}, of {state.st_size / 2**30:,.1f} GiB,", "make it smaller")
            return file.read()
    except FileNotFoundError as error:
        raise DeuxError(f"{path} is missing.") from error
    except OSError as error:
        raise DeuxError(f"{path} cannot be read: {error.strerror}.") from error
    except ValueError as error:  # a null byte in the name
        raise DeuxError(f"{path} cannot be read: it is not a valid file name.") from error


def read_text_bytes(path: Path) -> bytes:
    """Read a whole text file without the byte order mark that some editors write.

    Raises:
        DeuxError: as `read_bytes`.
    """
    return read_bytes(path).removeprefix(codecs.BOM_UTF8)


def _open_at_once(path: str, flags: int) -> int:
    """Open without blocking: opening a pipe would otherwise wait for a writer."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def write_failure(path: Path, error: OSError, size: int | None = None) -> str:
    """The error message for a failed write of `size` bytes to the file `path`, or into the folder `path`."""
    if error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return f"{path} cannot be written: {error.strerror}."
    there = next(folder for folder in (path, *path.absolute().parents) if folder.is_dir())
    free = shutil.disk_usage(there).free // 1000
    needed = "" if size is None else f" ({math.ceil(size / 1000):,} kB)"
    return (
        f"The disk is full: {path}{needed} could not be written, {free:,} kB are free; free some space and start "
        "again, finished files are kept."
    )
