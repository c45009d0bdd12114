"""One of several processes that train together looks after the others: see `deux.training.rank_failures`."""

import os
import sys
import threading
import time
from contextlib import suppress
from typing import Any

import torch

from deux.errors import DeuxError

INTERVAL = 1.0
"""Seconds between two looks at the other processes."""

GRACE = 2.0
"""Seconds that a process has to end by itself once it knows of a failure; one that waits for the others cannot."""

SILENCE = 300.0
"""Seconds after which a process that shows no life counts as dead."""

_PATIENCE = 10.0  # seconds that a process which has failed waits for the others to have heard of it
_FAILURE = "failure"


class RankWatch(threading.Thread):
    """Looks after the other processes, and ends this one when one of them has failed or died.

    Args:
        store: a connection to the store that the processes share, of this object's own.
        rank: of this process.
        world_size: number of processes.
        interval: seconds between two looks.
        silence: seconds after which a process without a sign of life counts as dead.

    Attributes:
        failed: whether this process ends before it has done its part.
    """

    def __init__(
        self,
        store: torch.distributed.Store,
        rank: int,
        world_size: int,
        interval: float = INTERVAL,
        silence: float = SILENCE,
    ) -> None:
        super().__init__(daemon=True, name="rank watch")
        self._store, self._rank, self._world_size = store, rank, world_size
        self._interval, self._silence = interval, silence
        self.failed = False
        self._ending = threading.Event()
        self._lock = threading.Lock()  # one connection, two threads
        self._seen: dict[int, tuple[str, float]] = {}

    def run(self) -> None:
        """Look at the others until this process ends."""
        beat = 0
        while not self._ending.wait(self._interval):
            beat += 1
            sentence = self._look(beat)
            if sentence is not None and not self._ending.wait(GRACE):
                print(f"deux: {sentence}", file=sys.stderr, flush=True)
                os._exit(1)  # the main thread may wait for ever in a collective operation

    def stop(self) -> None:
        """Stop looking. A thread that Python ends within a call of the store takes the process down with SIGABRT.

        A process that has done its part takes back its last sign of life, or it would count as dead where the leading
        one goes on alone, such as in an evaluation.
        """
        self._ending.set()
        self.join(timeout=_PATIENCE)
        if self.failed or self.is_alive():
            return
        with self._lock, suppress(RuntimeError):  # the leading process may have ended, and the store with it
            self._store.set(_alive(self._rank), "")

    def fail(self, error: BaseException, sentence: str) -> DeuxError | None:
        """As `deux.training.rank_failures.told_to_all`."""
        self.failed = True
        self._ending.set()
        lost_contact = _is_distributed(error)
        deadline = time.monotonic() + (_PATIENCE if lost_contact else 0.0)
        while (found := self._failure()) is None and time.monotonic() < deadline:
            time.sleep(0.1)
        if found is not None:
            return DeuxError(found)
        if lost_contact:
            return DeuxError(
                f"another of the {self._world_size} processes that train together has ended without a word, as when "
                "the system kills one for want of memory; the same command goes on from the last checkpoint."
            )
        with self._lock:
            self._store.set(_FAILURE, f"process {self._rank} of the {self._world_size} that train together: {sentence}")
        self._wait_until_heard()
        return None

    def _look(self, beat: int) -> str | None:
        """Show life; the sentence of what is wrong with another process, or None."""
        try:
            with self._lock:
                self._store.set(_alive(self._rank), str(beat))
            return self._failure() or self._silent()
        except RuntimeError:  # the leading process serves the store
            return "the leading one of the processes that train together has ended."

    def _failure(self) -> str | None:
        """The sentence of a process that has failed; it learns that this one has heard of it."""
        try:
            with self._lock:
                if not self._store.check([_FAILURE]):
                    return None
                self._store.set(_heard(self._rank), "1")
                return str(self._store.get(_FAILURE).decode())
        except RuntimeError:
            return None

    def _silent(self) -> str | None:
        """The sentence of a process that shows no life any more."""
        now = time.monotonic()
        for rank in range(self._world_size):
            with self._lock:
                there = rank != self._rank and self._store.check([_alive(rank)])
                beat = self._store.get(_alive(rank)).decode() if there else ""
            if beat != self._seen.get(rank, (None, 0.0))[0]:
                self._seen[rank] = beat, now
            elif beat and now - self._seen[rank][1] > self._silence:
                return (
                    f"process {rank} of the {self._world_size} that train together has shown no life for "
                    f"{self._silence:.0f} s."
                )
        return None

    def _wait_until_heard(self) -> None:
        """Give the others time to hear of a failure: if this process leads, the store ends with it."""
        others = [_heard(rank) for rank in range(self._world_size) if rank != self._rank]
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline:
            with self._lock:
                if self._store.check(others):
                    return
            time.sleep(0.1)


def _alive(rank: int) -> str:
    return f"alive-{rank}"


def _heard(rank: int) -> str:
    return f"heard-{rank}"


def _is_distributed(error: BaseException) -> bool:
    """Whether an operation between processes has failed."""
    known: tuple[Any, ...] = (torch.distributed.DistError,)
    return isinstance(error, known) or (isinstance(error, RuntimeError) and "gloo" in str(error))
