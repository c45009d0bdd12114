"""One process at a time, across processes."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deux.errors import DeuxError


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold an exclusive lock on a file, which stays behind empty; the system frees it if the process dies.

    Waits until the process that holds it is done.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextmanager
def locked_at_once(path: Path, taken: str) -> Iterator[None]:
    """As `locked`, but without waiting.

    Args:
        path: the file.
        taken: the sentence for a lock that another process holds.

    Raises:
        DeuxError: another process holds it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DeuxError(taken) from None
        yield
