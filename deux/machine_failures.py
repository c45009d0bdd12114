"""Errors that are neither the user's nor the program's: what the machine does not have or allow, in sentences."""

from __future__ import annotations

import errno
import re
import traceback
from pathlib import Path

from deux.io.atomic import write_failure

PLACE_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EEXIST)
"""The system's errors that say that files cannot be written where they are to go."""

_NAME_ERRORS = (errno.ENAMETOOLONG, errno.ELOOP, errno.EILSEQ)
"""Those that say that there can be no file of this name."""

_COUNT_ERRORS = (errno.EMFILE, errno.ENFILE)
"""Those that say that too many files are open."""

_SHARED_MEMORY = re.compile(r"shared memory|Bus error|torch_\d+_\d+", re.IGNORECASE)
"""In messages of torch's, over batches that one process hands to another in /dev/shm."""

_DEAD_LOADER = re.compile(r"DataLoader worker .*?(?P<how>killed by signal: \w+( \w+)?|exited unexpectedly)", re.DOTALL)
"""In torch's message over a process that has died which loaded frames."""

_MORE_SHARED_MEMORY = (
    "give it room, as by docker run --shm-size=1g, or take training.num_workers=0 and collect.processes=1."
)


def machine_failure(error: BaseException, run_folder: Path | None) -> str | None:
    """The sentence for an error that the machine is behind, with the remedy; None for any other.

    Args:
        error: of a job, or of what happens before it.
        run_folder: of the job; None before there is one.
    """
    if isinstance(error, MemoryError):
        return "there is not enough memory for this: choose smaller frames, batches or scenes."
    if isinstance(error, OSError):
        return _system_failure(error, run_folder)
    return _loader_failure(str(error)) if isinstance(error, RuntimeError) else None


def ended_by_sigterm(error: BaseException) -> bool:
    """Whether torch says that a process which loaded frames got SIGTERM, as all of a command's may at the same time."""
    found = _DEAD_LOADER.search(str(error)) if isinstance(error, RuntimeError) else None
    return found is not None and "Terminated" in found["how"]


def _system_failure(error: OSError, run_folder: Path | None) -> str | None:
    modules = {frame.f_globals.get("__name__") for frame, _ in traceback.walk_tb(error.__traceback__)}
    if "multiprocessing.synchronize" in modules:  # whose locks lie in /dev/shm
        return f"processes cannot share memory in /dev/shm, {error.strerror}: {_MORE_SHARED_MEMORY}"
    if error.errno in _NAME_ERRORS:
        return f"{error.filename or 'a name of a file'} cannot be used: {error.strerror}."
    if error.errno in _COUNT_ERRORS:
        return f"{error.strerror}: raise the number of files that a process may open, as by ulimit -n 1024."
    if error.errno not in PLACE_ERRORS:
        return None
    place = error.filename or run_folder
    if not place:  # Hydra's own files, before the job begins
        return f"the run folder cannot be written: {error.strerror}; make room and start again."
    return write_failure(Path(place), error)


def _loader_failure(message: str) -> str | None:
    """The sentence for what torch says of processes that load frames."""
    if _SHARED_MEMORY.search(message) and ("DataLoader" in message or "shared memory" in message):
        return f"the processes that load frames have too little shared memory in /dev/shm: {_MORE_SHARED_MEMORY}"
    found = _DEAD_LOADER.search(message)
    if found is None:
        return None
    return (
        f"a process that loads frames has {'been ' if 'killed' in found['how'] else ''}{found['how']}, as where memory "
        "runs out: the same command goes on where it stopped, with training.num_workers=0 in less memory."
    )
