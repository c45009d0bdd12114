"""Several processes that share work, and end with the one that started them."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

T = TypeVar("T")


def in_processes(work: Callable[[T], Any], items: Sequence[T], processes: int, done: Callable[[T], None]) -> None:
    """Call `work` for each item, several at a time. Spawned: a forked child would hang in EGL and OpenMP.

    An error in one of them, or Ctrl-C, ends all.

    Args:
        work: picklable.
        items: picklable.
        processes: number of processes.
        done: called here with each item that is finished.
    """
    context = multiprocessing.get_context("spawn")
    stopped, stop = context.Pipe(duplex=False)
    with ProcessPoolExecutor(processes, context, initializer=_end_when, initargs=(stopped,)) as pool:
        with _interrupts_held():
            tasks = {pool.submit(work, item): item for item in items}
        try:
            for task in as_completed(tasks):
                task.result()
                done(tasks[task])
        except BaseException:
            stop.close()  # the pool itself would wait for the end of the work that is under way
            raise


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keep Ctrl-C waiting. Processes that start meanwhile never get it: they end with this one, in silence."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_when(stopped: Connection) -> None:
    """Let this process end at once when the other end of the connection is closed, or when its parent dies.

    A killed run's children would otherwise write on beside its successor.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait([parent.sentinel, stopped])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
