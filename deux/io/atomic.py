"""Files that appear whole or not at all, and files that are read whole."""

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
    """Write a file under a temporary name beside it, then move it into place.

    The temporary name depends on the path alone, so that a run that was killed leaves nothing that the next run
    does not overwrite. One process at a time may write one file.

    Raises:
        DeuxError: the file cannot be written, such as on a full disk.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    except OSError as error:
        with suppress(OSError):  # what kept the file from being written may keep it from being deleted
            temporary.unlink()
        raise DeuxError(write_failure(path, error, len(content))) from error


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, if it is not there.

    Raises:
        DeuxError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DeuxError(f"Folder {path} cannot be made: {error.strerror}.") from error


def write_json(path: Path, value: Any) -> None:
    """Write a value as indented JSON, atomically."""
    write_atomically(path, (json.dumps(value, indent=2) + "\n").encode())


def read_bytes(path: Path) -> bytes:
    """Read a whole file.

    A pipe or a device is refused: it may never end, or wait for a writer that never comes.

    Raises:
        DeuxError: the file is missing, cannot be read, is none, or is larger than memory has room for.
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
    except ValueError as error:  # a zero byte in a name
        raise DeuxError(f"{path} cannot be read: there can be no file of that name.") from error


def read_text_bytes(path: Path) -> bytes:
    """Read a whole text file, without the byte order mark that some editors put before UTF-8.

    Raises:
        DeuxError: as `read_bytes`.
    """
    return read_bytes(path).removeprefix(codecs.BOM_UTF8)


def _open_at_once(path: str, flags: int) -> int:
    """A pipe would be waited for before it can be told from a file."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def write_failure(path: Path, error: OSError, size: int | None = None) -> str:
    """The sentence for a failed write of `size` bytes to `path`, or to something in it if it is a folder."""
    if error.errno not in (errno.ENOSPC, errno.EDQUOT):
        return f"{path} cannot be written: {error.strerror}."
    there = next(folder for folder in (path, *path.absolute().parents) if folder.is_dir())
    free = shutil.disk_usage(there).free // 1000
    needed = "" if size is None else f" ({math.ceil(size / 1000):,} kB)"
    return (
        f"The disk is full: {path}{needed} could not be written, {free:,} kB are free there; make room and start "
        "again, what is already written is kept."
    )
