"""Locks between processes, of one machine or of several that share a file system.

A lock is a file that its holder creates exclusively (open(2) with O_EXCL, which NFS since version 3, Lustre and local
disks do in one step) and removes at the end. It names the holder's machine and process. `flock` is not used: between
machines many network file systems grant it to both.

A holder that died does not block the others. On its own machine its process is looked up; for other machines it
refreshes the file's time every few seconds, and a waiter that has seen no refresh for the length of the lease takes
over. The waiter measures that with its own clock and compares times of the file only with each other, so the clocks of
the machines need not agree.

A holder that was suspended for longer than the lease may find that another process took over. Its next refresh notices
and interrupts it. What it writes until then are the files that the other process makes as well, with the same content
and each by a rename; at worst one of the two stops with a sentence. Before a step that must happen once, ask
`Lock.confirm`.
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
"""How the names of locks end."""

_REFRESHES = 12
"""Number of refreshes in the length of a lease."""

_POLL = (0.02, 1.0)
"""Shortest and longest time between a waiter's attempts, seconds."""

_NOTICE_AFTER = 5.0
"""Seconds after which a waiter says whom it waits for."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Holder:
    """Who holds a lock: the content of the lock's file.

    Args:
        host: name of the machine.
        machine: identifier of the running system in which `pid` is counted.
        pid: process id.
        started: start time of the process in ticks of the system's clock, since process ids are used again; None where
            the system does not tell.
        work: what the holder does meanwhile, as in "which <work>".
        lease: seconds without a refresh after which others may take over.
        token: a random name of this hold.
    """

    host: str
    machine: str
    pid: int
    started: int | None
    work: str
    lease: float
    token: str

    def is_here(self) -> bool:
        """Whether it is a process of this machine, so that `is_gone` can tell."""
        return self.machine == _machine()

    def is_gone(self) -> bool:
        """Whether it was a process of this machine that has ended."""
        if not self.is_here():
            return False
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return True
        except PermissionError:
            pass  # it lives, and belongs to another user
        return self.started is not None and _start_time(self.pid) != self.started

    def __str__(self) -> str:
        return f"{self.host}:{self.pid}, which {self.work}"


class Lock:
    """A lock that this process holds; made by `locked` and `locked_at_once`.

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
        """Make sure that the lock is still this process's.

        Raises:
            DeuxError: it is not: another process took over, or the file was deleted.
        """
        found = _read(self.path)
        if self.lost or found is None or found[0] != self.holder:
            self.lost = True
            now = f"{found[0]} holds it now" if found and found[0] else "its file is gone"
            raise DeuxError(
                f"The lock {self.path} was lost, {now}: this process was suspended for {self.holder.lease:.0f} s or "
                "longer, or the file was deleted; start the same command again, it goes on from here."
            )

    def release(self) -> None:
        """Let the next process have the lock."""
        self._released.set()
        self._refreshing.join()
        with suppress(OSError):  # such as of a disk that has become read-only: others take over after the lease
            _remove(self.path, self.holder)

    def _refresh(self) -> None:
        """Renew the time of the file until the lock is released or lost."""
        missing = False
        while not self._released.wait(self.holder.lease / _REFRESHES):
            try:
                found = _read(self.path)
                if found and found[0] == self.holder:
                    os.utime(self.path)
                    missing = False
                    continue
            except OSError:
                continue  # the file system is away; whether others took over meanwhile, the next turn tells
            if found or missing:
                self.lost = True
                # Not while a handler is absent: the signal would then end the process without a word.
                if self._interrupts and callable(signal.getsignal(signal.SIGINT)):
                    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
                return
            missing = True  # for one turn: `_remove` of another process may be about to put it back


@contextmanager
def locked(path: Path, work: str, lease: float = LEASE) -> Iterator[Lock]:
    """Hold an exclusive lock, after waiting until the process that holds it is done or dead.

    A wait of more than some seconds is logged once, with the holder's name. Locks of different files nest.

    Args:
        path: the lock's file, which is there only while the lock is held.
        work: what is done meanwhile, told to those who wait: "collects flats-0123abcd".
        lease: seconds without a refresh after which others may take over.

    Raises:
        DeuxError: the file cannot be written; or, at the end or in place of an interrupt, the lock was lost meanwhile.
    """
    started, pause, watch = time.monotonic(), _POLL[0], _Watch(path)
    told = False
    while (lock := _try(path, work, lease)) is None:
        if watch.finds_it_free():
            continue
        if not told and time.monotonic() - started > _NOTICE_AFTER:
            told = True
            log.warning("waiting for %s (%s)", watch.holder or "a process that left no name", path)
        time.sleep(pause * random.uniform(0.5, 1.0))
        pause = min(1.5 * pause, _POLL[1])
    with _held(lock):
        yield lock


@contextmanager
def locked_at_once(path: Path, work: str, taken: str, lease: float = LEASE) -> Iterator[Lock]:
    """As `locked`, but without waiting for a holder that is alive.

    One of this machine is looked up at once. For one of another machine this waits for its next refresh, a twelfth of
    the lease, or until the lease is over.

    Args:
        path: the lock's file.
        work: what is done meanwhile.
        taken: the sentence for a lock that another process holds.
        lease: seconds without a refresh after which others may take over.

    Raises:
        DeuxError: another process holds it, or what `locked` raises.
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
    """Delete the file of a lock whose holder, a process of this machine, was killed when its work was done.

    Args:
        path: the lock's file; most often there is none.
    """
    with suppress(OSError):
        found = _read(path)
        if found and found[0] and found[0].is_gone():
            _remove(path, found[0])


@contextmanager
def _held(lock: Lock) -> Iterator[None]:
    """Release a lock at the end. If it was lost meanwhile, that is the error, whatever else came of it."""
    try:
        yield
    finally:
        try:
            if lock.lost:
                lock.confirm()
        finally:
            lock.release()


class _Watch:
    """What a waiter has seen of a lock's file.

    Args:
        path: the lock's file.

    Attributes:
        holder: who holds the lock; None if the file names nobody.
        refreshed: whether this holder has refreshed the file since the waiter first saw it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._time_ns, self._since = 0, -math.inf
        self.holder: Holder | None = None
        self.refreshed = False

    def finds_it_free(self) -> bool:
        """Look once more: whether the lock was released, or is removed now because its holder is dead."""
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
    """Take the lock, or None if its file is there."""
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
    """The holder and the time of the file, in ns; None without a file. A file that names nobody has no holder."""
    try:
        # Opened before its time is asked for: NFS then asks the server instead of its cache.
        with path.open("rb") as file:
            content, time_ns = file.read(), os.fstat(file.fileno()).st_mtime_ns
    except FileNotFoundError:
        return None
    try:
        return Holder(**json.loads(content)), time_ns
    except (ValueError, TypeError):
        return None, time_ns


def _remove(path: Path, holder: Holder | None) -> bool:
    """Remove the lock's file if it is this holder's, whether or not it lives; whether it was there.

    It is moved aside first, which one process alone can do, and put back if it turns out to be a later holder's.
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
    """Delete what processes of this machine left in a folder that were killed while they removed a lock.

    The file of a holder that lives stays: another process may be about to put it back.
    """
    for aside in folder.glob(f"*{SUFFIX}.*"):
        with suppress(OSError):
            found = _read(aside)
            if found and found[0] and found[0].is_gone():
                aside.unlink(missing_ok=True)


@cache
def _machine() -> str:
    """An identifier of this running system, or of this container: process ids are comparable where it is the same."""
    parts = [socket.gethostname()]
    with suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text().strip())
    with suppress(OSError):
        parts.append(str(os.stat("/proc/self/ns/pid").st_ino))
    return " ".join(parts)


def _start_time(pid: int) -> int | None:
    """When a process was started, in ticks; None if it has ended or the system does not tell (proc(5), field 22)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if fields[0] in "ZX" else int(fields[19])
