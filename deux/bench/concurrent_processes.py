"""Running the same job in several processes at once."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from threading import Barrier, BrokenBarrierError
from typing import Any, TypeVar

T = TypeVar("T")

_TIMEOUT = 600.0  # seconds; longer than any process lets the others wait


def at_once(work: Callable[[Any, Callable[[], None]], T], job: Any, processes: int, opengl_threads: int) -> list[T]:
    """Do one job in each of several newly spawned processes and return what each made of it.

    Args:
        work: called as `work(job, together)`; `together()` returns when all processes have called it. It and `job` must
            be picklable.
        job: what is to be done.
        processes: number of processes.
        opengl_threads: number of threads on which OpenGL without a graphics card draws in each process; numpy's linear
            algebra and OpenMP get one.
    """
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(processes)
    limits = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "LP_NUM_THREADS": str(opengl_threads)}
    with _environment(limits), ProcessPoolExecutor(processes, context, _keep, (barrier,)) as pool:
        futures = [pool.submit(_work, work, job) for _ in range(processes)]
        return [future.result() for future in sorted(futures, key=_broken_by_another)]


def _broken_by_another(future: "Future[Any]") -> bool:
    """Whether a process failed only because another one did: that one's error is to be raised first."""
    return isinstance(future.exception(), BrokenBarrierError)


@contextmanager
def _environment(changes: Mapping[str, str]) -> Iterator[None]:
    """Change environment variables for the processes that are spawned inside; libraries read them when imported."""
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
"""Function with which this process waits for the others."""


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
        barrier.abort()  # or the others would wait for this process
        raise
