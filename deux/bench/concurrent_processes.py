"""Function to run the same job in several processes at once."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from threading import Barrier, BrokenBarrierError
from typing import Any, TypeVar

T = TypeVar("T")

_TIMEOUT = 600.0  # seconds; longer than any process waits for the others


def at_once(work: Callable[[Any, Callable[[], None]], T], job: Any, processes: int, opengl_threads: int) -> list[T]:
    """Run one job in each of several newly spawned processes and return their results.

    Args:
        work: function that is called as `work(job, together)` in each process; `together()` is a barrier, which returns
            when all processes have called it. Must be picklable.
        job: argument of `work`; must be picklable.
        processes: number of processes.
        opengl_threads: number of threads of OpenGL's software renderer in each process. OpenMP and OpenBLAS use one
            thread.

    Returns:
        The results of all processes.
    """
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(processes)
    limits = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "LP_NUM_THREADS": str(opengl_threads)}
    with _environment(limits), ProcessPoolExecutor(processes, context, _keep, (barrier,)) as pool:
        futures = [pool.submit(_work, work, job) for _ in range(processes)]
        return [future.result() for future in sorted(futures, key=_broken_by_another)]


def _broken_by_another(future: "Future[Any]") -> bool:
    """Whether a process failed because another one did. Sorts such errors last, so that the original one is raised."""
    return isinstance(future.exception(), BrokenBarrierError)


@contextmanager
def _environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that are spawned inside; libraries read them on import."""
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


_barrier: Barrier | None = None
"""Barrier that this process shares with the others."""


def _keep(barrier: Barrier) -> None:
    global _barrier
    _barrier = barrier


def _work(work: Callable[[Any, Callable[[], None]], T], job: Any) -> T:
    assert _barrier is not None
    barrier = _barrier

    def together() -> None:
        barrier.wait(_TIMEOUT)

    try:
        return work(job, together)
    except BaseException:
        barrier.abort()  # otherwise the others would wait until the timeout
        raise
