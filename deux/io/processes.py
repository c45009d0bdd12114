"""Worker processes that share work and end with their parent."""

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from deux.errors import DeuxError

T = TypeVar("T")

Count = Callable[[int], None]
"""Called with the number of parts of the work that were done since the last call."""

Work = Callable[[T, Count], None]
"""Processes an item and counts the parts that are done."""


def in_processes(
    work: Work[T],
    items: Sequence[T],
    processes: int,
    count: Count,
    name: Callable[[T], str],
    prepare: Callable[[], Any] = int,
) -> None:
    """Process items in parallel, in spawned processes (forked ones would hang in EGL and OpenMP).

    Each process receives `work` once, and then one item at a time. An error in one of them, Ctrl-C, or the end of this
    process ends all of them.

    Args:
        work: the function that processes an item; picklable.
        items: the items; picklable.
        processes: greatest number of processes.
        count: called in this process with the number of parts that were done.
        name: the name of an item in messages.
        prepare: is called in each process before it receives `work`; picklable.

    Raises:
        DeuxError: a process has died, or the work raised it.
    """
    waiting = list(reversed(items))
    sent = pickle.dumps(work)
    with ExitStack() as started:
        busy = [_Process[T](prepare, waiting.pop(), name) for _ in range(min(processes, len(items)))]
        for process in busy:
            started.callback(process.kill)
        for process in busy:  # after all processes have been started, which then import in parallel
            process.send_work(sent)
        while busy:
            ready = wait([process.connection for process in busy])
            for process in [process for process in busy if process.connection in ready]:
                done = process.receive()
                if done is not None:
                    count(done)
                elif waiting:
                    process.send(waiting.pop())
                else:
                    busy.remove(process)


class _Process(Generic[T]):
    """A worker process, and the item that it works on.

    Args:
        prepare: is called first in the process.
        item: the first item.
        name: the name of an item in messages.
    """

    def __init__(self, prepare: Callable[[], Any], item: T, name: Callable[[T], str]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, other_end = context.Pipe()
        self._item, self._name = item, name
        self._process = context.Process(target=_serve, args=(other_end, prepare), daemon=True)
        with _interrupts_blocked():
            self._process.start()
        other_end.close()

    def send_work(self, pickled: bytes) -> None:
        """Send the pickled work, and then the first item."""
        with self._raising_if_dead():
            self.connection.send_bytes(pickled)
        self.send(self._item)

    def send(self, item: T) -> None:
        """Send the next item."""
        self._item = item
        with self._raising_if_dead():
            self.connection.send(item)

    def receive(self) -> int | None:
        """Receive the number of parts that were done, or None if the item is finished.

        Raises:
            DeuxError: the process has died.
            Exception: an error of the work.
        """
        with self._raising_if_dead():
            message = self.connection.recv()
        if isinstance(message, BaseException):
            raise message
        done: int | None = message
        return done

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.join()
        self.connection.close()

    @contextmanager
    def _raising_if_dead(self) -> Iterator[None]:
        """Raise DeuxError with the cause if the process has died."""
        try:
            yield
        except (EOFError, OSError) as error:
            self._process.join()
            code = self._process.exitcode or 0
            how = f"ended with exit code {code}"
            if code < 0:
                how = f"was killed by {signal.Signals(-code).name}"
            if code == -signal.SIGKILL:
                how += ", as the system does when memory runs out"
            raise DeuxError(
                f"The process that worked on {self._name(self._item)} {how}: run the same command again to resume, "
                "with fewer processes to use less memory."
            ) from error


def _serve(connection: Connection, prepare: Callable[[], Any]) -> None:
    """Process the items that arrive through the connection, until this process is killed."""
    _end_with_parent()
    try:
        prepare()
        work = pickle.loads(connection.recv_bytes())
        while True:
            work(connection.recv(), connection.send)
            connection.send(None)
    except BaseException as error:
        with suppress(OSError):  # the parent has ended
            connection.send(_portable(error))


def _portable(error: BaseException) -> BaseException:
    """The error with its stack trace as a note, unless it is a DeuxError; a RuntimeError if it cannot be pickled."""
    if isinstance(error, DeuxError):
        return error
    where = "".join(traceback.format_exception(error))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__} in another process")
    error.add_note(f"It happened in another process:\n{where}")
    return error


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block SIGINT. Processes that are started meanwhile inherit this, and end with this process instead."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_with_parent() -> None:
    """End this process when its parent dies; otherwise it would go on writing files beside the next run."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
