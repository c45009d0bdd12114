"""Several processes that share work, and end with the one that started them."""

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
"""Called with the number of parts of the work that have been done since the last call."""

Work = Callable[[T, Count], None]
"""Does what is to be done with an item, and counts its parts."""


def in_processes(
    work: Work[T],
    items: Sequence[T],
    processes: int,
    count: Count,
    name: Callable[[T], str],
    prepare: Callable[[], Any] = int,
) -> None:
    """Do the work on each item, several at a time. Spawned: a forked child would hang in EGL and OpenMP.

    Every process gets `work` once, and an item whenever it has none. An error in one of them, or Ctrl-C, ends all at
    once, and so does the end of this process.

    Args:
        work: picklable; it is sent by value.
        items: picklable.
        processes: number of processes at most.
        count: told here of the parts that are done, as they come.
        name: what messages call an item.
        prepare: picklable; called first in each process, before it gets `work`.

    Raises:
        DeuxError: a process has died, or the work raised it.
    """
    waiting = list(reversed(items))
    sent = pickle.dumps(work)
    with ExitStack() as started:
        busy = [_Process[T](prepare, waiting.pop(), name) for _ in range(min(processes, len(items)))]
        for process in busy:
            started.callback(process.kill)
        for process in busy:  # all have begun to import by now
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
    """A process, and the item that it works on.

    Args:
        prepare: called in it first.
        item: its first one.
        name: what messages call an item.
    """

    def __init__(self, prepare: Callable[[], Any], item: T, name: Callable[[T], str]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, other_end = context.Pipe()
        self._item, self._name = item, name
        self._process = context.Process(target=_serve, args=(other_end, prepare), daemon=True)
        with _interrupts_held():
            self._process.start()
        other_end.close()

    def send_work(self, pickled: bytes) -> None:
        """Send what is done with items, and then the first one."""
        with self._death_told():
            self.connection.send_bytes(pickled)
        self.send(self._item)

    def send(self, item: T) -> None:
        """Send the next item."""
        self._item = item
        with self._death_told():
            self.connection.send(item)

    def receive(self) -> int | None:
        """The number of parts that are newly done, or None if the item is.

        Raises:
            DeuxError: the process has died.
            Exception: what the work raised.
        """
        with self._death_told():
            message = self.connection.recv()
        if isinstance(message, BaseException):
            raise message
        done: int | None = message
        return done

    def kill(self) -> None:
        """End it, whatever it is doing."""
        self._process.kill()
        self._process.join()
        self.connection.close()

    @contextmanager
    def _death_told(self) -> Iterator[None]:
        """Say how the process has died if nobody is at the other end."""
        try:
            yield
        except (EOFError, OSError) as error:
            self._process.join()
            code = self._process.exitcode or 0
            how = f"ended with exit code {code}"
            if code < 0:
                how = f"was killed by {signal.Signals(-code).name}"
            if code == -signal.SIGKILL:
                how += ", which is what the system does when memory runs out"
            raise DeuxError(
                f"The process that worked on {self._name(self._item)} {how}: the same command goes on where it "
                "stopped, with fewer processes in less memory."
            ) from error


def _serve(connection: Connection, prepare: Callable[[], Any]) -> None:
    """Work on the items that come through the connection, until this process is killed."""
    _end_with_parent()
    try:
        prepare()
        work = pickle.loads(connection.recv_bytes())
        while True:
            work(connection.recv(), connection.send)
            connection.send(None)
    except BaseException as error:
        with suppress(OSError):  # nobody is there any more
            connection.send(_portable(error))


def _portable(error: BaseException) -> BaseException:
    """The error, with where it happened if it is no mistake of the user's; another one if it cannot be pickled."""
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
def _interrupts_held() -> Iterator[None]:
    """Keep Ctrl-C waiting. Processes that start meanwhile never get it: they end with this one, in silence."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_with_parent() -> None:
    """Let this process end at once when its parent dies.

    A killed run's children would otherwise write on beside its successor.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
