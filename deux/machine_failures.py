"""Messages about errors that are caused by limits of the machine, such as memory, disk space or permissions."""

from __future__ import annotations

import errno
import re
import traceback
from pathlib import Path

from deux.io.atomic import write_failure

PLACE_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EEXIST)
"""Error numbers for files that cannot be written at their location."""

_NAME_ERRORS = (errno.ENAMETOOLONG, errno.ELOOP, errno.EILSEQ)
"""Error numbers for invalid file names."""

_COUNT_ERRORS = (errno.EMFILE, errno.ENFILE)
"""Error numbers for too many open files."""

_SHARED_MEMORY = re.compile(r"shared memory|Bus error|torch_\d+_\d+", re.IGNORECASE)
"""Occurs in torch's messages about batches that are passed between processes in /dev/shm."""

_DEAD_LOADER = re.compile(r"DataLoader worker .*?(?P<how>killed by signal: \w+( \w+)?|exited unexpectedly)", re.DOTALL)
"""Occurs in torch's message about a data loader worker that died."""

_MORE_SHARED_MEMORY = (
    "increase it, such as by docker run --shm-size=1g, or set training.num_workers=0 and collect.processes=1."
)


def machine_failure(error: BaseException, run_folder: Path | None) -> str | None:
    """The message, with a remedy, about an error that is caused by the machine; None for other errors.

    Args:
        error: an error of a job, or before it.
        run_folder: run folder of the job; None before there is one.
    """
    if isinstance(error, MemoryError):
        return "there is not enough memory: choose smaller frames, batches or scenes."
    if isinstance(error, OSError):
        return _system_failure(error, run_folder)
    return _loader_failure(str(error)) if isinstance(error, RuntimeError) else None


def ended_by_sigterm(error: BaseException) -> bool:
    """Whether a data loader worker was ended by SIGTERM, which may be sent to all processes of a command."""
    match = _DEAD_LOADER.search(str(error)) if isinstance(error, RuntimeError) else None
    return match is not None and "Terminated" in match["how"]


def _system_failure(error: OSError, run_folder: Path | None) -> str | None:
    modules = {frame.f_globals.get("__name__") for frame, _ in traceback.walk_tb(error.__traceback__)}
    if "multiprocessing.synchronize" in modules:  # its locks are in /dev/shm
        return f"processes cannot share memory in /dev/shm, {error.strerror}: {_MORE_SHARED_MEMORY}"
    if error.errno in _NAME_ERRORS:
        return f"{error.filename or 'a file name'} cannot be used: {error.strerror}."
    if error.errno in _COUNT_ERRORS:
        return f"{error.strerror}: raise the limit of open files, such as by ulimit -n 1024."
    if error.errno not in PLACE_ERRORS:
        return None
    place = error.filename or run_folder
    if not place:  # Hydra's own files, before the job starts
        return f"the run folder cannot be written, {error.strerror}: make room and start again."
    return write_failure(Path(place), error)


def _loader_failure(message: str) -> str | None:
    """The message about a failed data loader worker, from torch's message; None if it is about something else."""
    if _SHARED_MEMORY.search(message) and ("DataLoader" in message or "shared memory" in message):
        return f"the processes that load frames have too little shared memory in /dev/shm: {_MORE_SHARED_MEMORY}"
    match = _DEAD_LOADER.search(message)
    if match is None:
        return None
    return (
        f"a process that loads frames has {'been ' if 'killed' in match['how'] else ''}{match['how']}, possibly for "
        "lack of memory: the same command resumes; with training.num_workers=0 it needs less memory."
    )
