"""Locks between processes on one machine, or on several machines that share a file system.

A lock is a file that its holder creates exclusively (open(2) with O_EXCL, which is atomic on NFS since version 3,
Lustre and local disks) and removes at the end. It records the holder's machine and process. `flock` is not used,
because many network file systems grant it to several machines at once.

A dead holder does not block others. On the same machine, its process is looked up. For other machines, the holder
updates the file's modification time every few seconds, and a waiter that has seen no update for the length of the lease
takes over. The waiter measures this with its own clock and compares modification times only with each other, so the
clocks of the machines need not agree.

A holder that was suspended for longer than the lease may lose the lock to another process. Its next refresh notices
this and interrupts it. Until then it writes the same files as the other process, with the same content and atomically;
at worst one of the two stops with an error. Call `Lock.confirm` before a step that must happen only once.
"""

from __future__ import annotations

import json
import logging
import math
import os
import random
import secrets
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from deux.errors import DeuxError
from deux.io.atomic import make_folder, write_failure

LEASE = 60.0
"""Seconds without a refresh after which a lock of another machine may be taken over."""

SUFFIX = ".lock.json"
"""Suffix of the names of lock files."""

_REFRESHES = 12
"""Number of refreshes per lease."""

_POLL = (0.02, 1.0)
"""Shortest and longest time between a waiter's attempts, seconds."""

_NOTICE_AFTER = 5.0
"""Seconds after which a waiter logs whom it waits for."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Holder:
    """The holder of a lock; the content of the lock's file.

    Args:
        host: name of the machine.
        machine: identifier of the running system to which `pid` belongs.
        pid: process id.
        started: start time of the process in clock ticks, because process ids are reused; None if it is unknown.
        work: description of the holder's work, for messages such as "host:pid, which <work>".
        lease: seconds without a refresh after which others may take over.
        token: a random identifier of this acquisition.
    """

    host: str
    machine: str
    pid: int
    started: int | None
    work: str
    lease: float
    token: str

    def is_here(self) -> bool:
        """Whether the holder is a process of this machine, for which `is_gone` can be determined."""
        return self.machine == _machine()

    def is_gone(self) -> bool:
        """Whether the holder was a process of this machine that has ended."""
        if not self.is_here():
            return False
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return True
        except PermissionError:
            pass  # it is alive and belongs to another user
        return self.started is not None and _start_time(self.pid) != self.started

    def __str__(self) -> str:
        return f"{self.host}:{self.pid}, which {self.work}"


class Lock:
    """A lock that this process holds; created by `locked` and `locked_at_once`.

    Args:
        path: the lock's file.
        holder: this process.
    """

    def __init__(self, path: Path, holder: Holder) -> None:
        self.path = path
        self.holder = holder
        self.lost = False
        self._interrupts = threading.current_thread() is threading.main_thread()
        self._released = threading.Event()
        self._refreshing = threading.Thread(target=self._refresh, name=f"lock {path.name}", daemon=True)
        self._refreshing.start()

    def confirm(self) -> None:
        """Check that this process still holds the lock.

        Raises:
            DeuxError: another process took over, or the file was deleted.
        """
        found = _read(self.path)
        if self.lost or found is None or found[0] != self.holder:
            self.lost = True
            now = f"{found[0]} holds it now" if found and found[0] else "its file was deleted"
            raise DeuxError(
                f"The lock {self.path} was lost, {now}: this process was suspended for {self.holder.lease:.0f} s or "
                "longer, or the file was deleted; start the same command again to resume."
            )

    def release(self) -> None:
        """Release the lock."""
        self._released.set()
        self._refreshing.join()
        with suppress(OSError):  # for example if the disk has become read-only; others take over after the lease
            _remove(self.path, self.holder)

    def _refresh(self) -> None:
        """Update the modification time of the file until the lock is released or lost."""
        missing = False
        while not self._released.wait(self.holder.lease / _REFRESHES):
            try:
                found = _read(self.path)
                if found and found[0] == self.holder:
                    os.utime(self.path)
                    missing = False
                    continue
            except OSError:
                continue  # the file system is not available: check again at the next refresh
            if found or missing:
                self.lost = True
                # Without a handler the signal would end the process without a message.
                if self._interrupts and callable(signal.getsignal(signal.SIGINT)):
                    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
                return
            missing = True  # lost only if it is missing twice: `_remove` of another process may restore it


@contextmanager
def locked(path: Path, work: str, lease: float = LEASE) -> Iterator[Lock]:
    """Acquire an exclusive lock, waiting until its holder releases it or is dead.

    A wait of more than a few seconds is logged once, with the holder. Locks of different files can be nested.

    Args:
        path: the lock's file, which exists only while the lock is held.
        work: description of the work for those who wait, such as "collects flats-0123abcd".
        lease: seconds without a refresh after which others may take over.

    Raises:
        DeuxError: the file cannot be written; or, at the end or instead of an interrupt, the lock was lost.
    """
    started, pause, watch = time.monotonic(), _POLL[0], _Watch(path)
    logged = False
    while (lock := _try(path, work, lease)) is None:
        if watch.finds_it_free():
            continue
        if not logged and time.monotonic() - started > _NOTICE_AFTER:
            logged = True
            log.warning("waiting for %s (%s)", watch.holder or "an unknown process", path)
        time.sleep(pause * random.uniform(0.5, 1.0))
        pause = min(1.5 * pause, _POLL[1])
    with _held(lock):
        yield lock


@contextmanager
def locked_at_once(path: Path, work: str, taken: str, lease: float = LEASE) -> Iterator[Lock]:
    """Acquire an exclusive lock like `locked`, but without waiting for a holder that is alive.

    A holder on another machine is alive if it refreshes the file, which it does twelve times per lease; this waits for
    its next refresh or the end of the lease.

    Args:
        path: the lock's file.
        work: see `locked`.
        taken: the error message if another process holds the lock.
        lease: seconds without a refresh after which others may take over.

    Raises:
        DeuxError: another process holds the lock, or as `locked`.
    """
    watch = _Watch(path)
    while (lock := _try(path, work, lease)) is None:
        if watch.finds_it_free():
            continue
        if watch.refreshed or (watch.holder and watch.holder.is_here()):
            raise DeuxError(taken)
        time.sleep(min(_POLL[1], lease / (2 * _REFRESHES)))
    with _held(lock):
        yield lock


def clear_abandoned(path: Path) -> None:
    """Delete a lock's file if its holder is a dead process of this machine.

    Args:
        path: the lock's file, which need not exist.
    """
    with suppress(OSError):
        found = _read(path)
        if found and found[0] and found[0].is_gone():
            _remove(path, found[0])


@contextmanager
def _held(lock: Lock) -> Iterator[None]:
    """Release a lock at the end; raise DeuxError if it was lost, in place of any other error."""
    try:
        yield
    finally:
        try:
            if lock.lost:
                lock.confirm()
        finally:
            lock.release()


class _Watch:
    """A waiter's observations of a lock's file.

    Args:
        path: the lock's file.

    Attributes:
        holder: the holder of the lock; None if it is unknown.
        refreshed: whether the holder has refreshed the file since the waiter first saw it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._time_ns, self._since = 0, -math.inf
        self.holder: Holder | None = None
        self.refreshed = False

    def finds_it_free(self) -> bool:
        """Whether the lock is free: it was released, or it is removed now because its holder is dead."""
        found = _read(self._path)
        if found is None:
            return True
        holder, time_ns = found
        if found != (self.holder, self._time_ns):
            self.refreshed = holder is not None and holder == self.holder
            self.holder, self._time_ns, self._since = holder, time_ns, time.monotonic()
        unrefreshed = time.monotonic() - self._since
        if (holder and holder.is_gone()) or unrefreshed > (holder.lease if holder else LEASE):
            return _remove(self._path, holder)
        return False


def _try(path: Path, work: str, lease: float) -> Lock | None:
    """Acquire the lock; None if its file exists."""
    make_folder(path.parent)
    holder = Holder(
        socket.gethostname(), _machine(), os.getpid(), _start_time(os.getpid()), work, lease, secrets.token_hex(8)
    )
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    except FileExistsError:
        return None
    except OSError as error:
        raise DeuxError(write_failure(path, error)) from error
    try:
        os.write(file, json.dumps(asdict(holder)).encode())
        os.close(file)
        _clear_asides(path.parent)
        return Lock(path, holder)
    except BaseException as error:
        with suppress(OSError):
            path.unlink()
        if isinstance(error, OSError):
            raise DeuxError(write_failure(path, error)) from error
        raise


def _read(path: Path) -> tuple[Holder | None, int] | None:
    """The holder (None if unknown) and the modification time in ns; None if the file does not exist."""
    try:
        # Opening the file before fstat makes NFS ask the server instead of its cache.
        with path.open("rb") as file:
            content, time_ns = file.read(), os.fstat(file.fileno()).st_mtime_ns
    except FileNotFoundError:
        return None
    try:
        return Holder(**json.loads(content)), time_ns
    except (ValueError, TypeError):
        return None, time_ns


def _remove(path: Path, holder: Holder | None) -> bool:
    """Remove the lock's file if it belongs to a holder, dead or alive; returns whether it was removed.

    The file is renamed first, which only one process can do, and restored if it belongs to a later holder.
    """
    found = _read(path)
    if found is None or found[0] != holder:
        return False
    aside = path.with_name(f"{path.name}.{secrets.token_hex(4)}")
    try:
        os.rename(path, aside)
    except FileNotFoundError:
        return False
    moved = _read(aside)
    if moved and moved[0] != holder:
        with suppress(OSError):
            os.link(aside, path)
    aside.unlink(missing_ok=True)
    return moved is not None and moved[0] == holder


def _clear_asides(folder: Path) -> None:
    """Delete renamed files in a folder that killed processes left behind in `_remove`.

    The file of a holder that is alive is kept, because another process may be about to restore it.
    """
    for aside in folder.glob(f"*{SUFFIX}.*"):
        with suppress(OSError):
            found = _read(aside)
            if found and found[0] and found[0].is_gone():
                aside.unlink(missing_ok=True)


@cache
def _machine() -> str:
    """An identifier of this running system or container, within which process ids are unique."""
    parts = [socket.gethostname()]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text().strip())
    with suppress(OSError):
        parts.append(str(os.stat("/proc/self/ns/pid").st_ino))
    return " ".join(parts)


def _start_time(pid: int) -> int | None:
    """Start time of a process in clock ticks (proc(5), field 22); None if it has ended or the time is unknown."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if fields[0] in "ZX" else int(fields[19])
