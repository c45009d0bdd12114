"""The thread by which a process of a distributed training monitors the others; see `deux.training.rank_failures`."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import torch

from deux.errors import DeuxError

INTERVAL = 1.0
"""Seconds between two checks of the other processes."""

GRACE = 2.0
"""Seconds in which a process can end by itself after another one's failure; then it is ended."""

_GRACE_AFTER_KILL = 0.5
"""The same after a child process was killed: Lightning kills this one, without a message, within five seconds."""

SILENCE = 300.0
"""Seconds without a heartbeat after which a process counts as dead."""

_PATIENCE = 10.0  # seconds that a failed process waits until the others have read its failure
_FAILURE = "failure"


class RankWatch(threading.Thread):
    """Monitors the other processes, and ends this one if one of them fails or dies.

    Args:
        store: a connection to the shared store that nothing else uses.
        rank: rank of this process.
        world_size: number of processes.
        interval: seconds between two checks.
        silence: seconds without a heartbeat after which a process counts as dead.
        children: the processes of the following ranks, if this process started them.

    Attributes:
        failed: whether this process ends before its work is done.
    """

    def __init__(
        self,
        store: torch.distributed.Store,
        rank: int,
        world_size: int,
        interval: float = INTERVAL,
        silence: float = SILENCE,
        children: Sequence[subprocess.Popen[Any]] = (),
    ) -> None:
        super().__init__(daemon=True, name="rank watch")
        self._store, self._rank, self._world_size = store, rank, world_size
        self._interval, self._silence, self._children = interval, silence, children
        self.failed = False
        self._ending = threading.Event()
        self._lock = threading.Lock()  # two threads use the connection
        self._seen: dict[int, tuple[str, float]] = {}

    def run(self) -> None:
        """Check the others until this process ends."""
        beat = 0
        while not self._ending.wait(self._interval):
            beat += 1
            killed = self._killed()
            sentence = killed or self._check(beat)
            if sentence is not None and not self._ending.wait(_GRACE_AFTER_KILL if killed else GRACE):
                print(f"deux: {sentence}", file=sys.stderr, flush=True)
                os._exit(1)  # the main thread may wait forever in a collective operation

    def stop(self) -> None:
        """Stop the thread: if Python ends during one of its calls of the store, the process dies by SIGABRT.

        A process that has done its work removes its heartbeat. Otherwise it would count as dead while the leading
        process continues alone, such as in an evaluation.
        """
        self._ending.set()
        self.join(timeout=_PATIENCE)
        if self.failed or self.is_alive():
            return
        with self._lock, suppress(RuntimeError):  # the leading process may have ended, and with it the store
            self._store.set(_alive(self._rank), "")

    def fail(self, error: BaseException, sentence: str) -> DeuxError | None:
        """See `deux.training.rank_failures.share_failure`."""
        self.failed = True
        self._ending.set()
        lost_contact = _is_distributed(error)
        deadline = time.monotonic() + (_PATIENCE if lost_contact else 0.0)
        while (found := self._failure()) is None and time.monotonic() < deadline:
            if found := self._killed():
                break
            time.sleep(0.1)
        if found is not None:
            return DeuxError(found)
        if lost_contact:
            return DeuxError(
                f"another of the {self._world_size} processes that train together has ended without a message, such as "
                "when the system kills one for lack of memory; the same command resumes from the last checkpoint."
            )
        with self._lock:
            self._store.set(_FAILURE, f"process {self._rank} of the {self._world_size} that train together: {sentence}")
        self._wait_until_read()
        return None

    def _check(self, beat: int) -> str | None:
        """Send a heartbeat; return a message if another process has failed or died."""
        try:
            with self._lock:
                self._store.set(_alive(self._rank), str(beat))
            return self._failure() or self._silent()
        except RuntimeError:  # the leading process serves the store
            return "the leading one of the processes that train together has ended."

    def _failure(self) -> str | None:
        """The message of a process that has failed, or None; notes in the store that this process has read it."""
        try:
            with self._lock:
                if not self._store.check([_FAILURE]):
                    return None
                self._store.set(_has_read(self._rank), "1")
                return str(self._store.get(_FAILURE).decode())
        except RuntimeError:
            return None

    def _silent(self) -> str | None:
        """A message if the heartbeat of another process has stopped."""
        now = time.monotonic()
        for rank in range(self._world_size):
            with self._lock:
                there = rank != self._rank and self._store.check([_alive(rank)])
                beat = self._store.get(_alive(rank)).decode() if there else ""
            if beat != self._seen.get(rank, (None, 0.0))[0]:
                self._seen[rank] = beat, now
            elif beat and now - self._seen[rank][1] > self._silence:
                return (
                    f"process {rank} of the {self._world_size} that train together has sent no heartbeat for "
                    f"{self._silence:.0f} s."
                )
        return None

    def _killed(self) -> str | None:
        """A message if a signal ended a process that this one started."""
        for rank, child in enumerate(self._children, start=self._rank + 1):
            if (code := child.poll()) is not None and code < 0:
                name = signal.Signals(-code).name
                reason = ", possibly for lack of memory" if name == "SIGKILL" else ""
                return (
                    f"process {rank} of the {self._world_size} that train together was ended by {name}{reason}; the "
                    "same command resumes from the last checkpoint."
                )
        return None

    def _wait_until_read(self) -> None:
        """Wait until the others have read this failure: if this process leads, the store ends with it."""
        others = [_has_read(rank) for rank in range(self._world_size) if rank != self._rank]
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline:
            with self._lock:
                if self._store.check(others):
                    return
            time.sleep(0.1)


def _alive(rank: int) -> str:
    return f"alive-{rank}"


def _has_read(rank: int) -> str:
    return f"read-{rank}"


def _is_distributed(error: BaseException) -> bool:
    """Whether an error comes from communication between processes."""
    known: tuple[Any, ...] = (torch.distributed.DistError,)
    return isinstance(error, known) or (isinstance(error, RuntimeError) and "gloo" in str(error))
