"""Runs jobs in a worker process of a cluster, and streams their results."""

import os
import platform
import shutil
import socket
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from deux.collection.jobs import Job, JobRunner
from deux.errors import DeuxError
from deux.inference.threads import limit_threads
from deux.plugin_kinds import KINDS
from deux.registry import registry

_SECONDS = 0.5
"""Seconds between two parts of a job's results."""

_PART_BYTES = 32 * 2**20
"""Size from which on a part is sent."""


class SentFile(NamedTuple):
    """A plan's file that is sent to the main process.

    Args:
        plan: index of the plan in its job.
        name: path relative to the plan's folder.
        content: the file's content.
    """

    plan: int
    name: str
    content: bytes


class JobPart(NamedTuple):
    """The results of a job since the previous part.

    Args:
        done: new progress.
        files: finished files, to be written in this order; empty if the worker writes them itself.
    """

    done: int
    files: tuple[SentFile, ...] = ()


def package_versions() -> dict[str, str]:
    """The versions of Python and of all packages that affect frames, including plugins, by name."""
    packages = ("deux", "torch", "numpy", "scipy", "numba", "kornia", "opencv-python-headless", "embreex")
    plugins = {plugin.package: plugin.version for kind in KINDS for plugin in registry().plugins(kind)}
    return {"Python": platform.python_version(), **plugins, **{name: version(name) for name in packages}}


class JobWorker:
    """Runs jobs one after the other. Call `check`, then `load`, then `run` for each job.

    Args:
        threads: number of threads to compute with.
        card: whether a GPU, or a share of one, is reserved for it; otherwise it uses none.
    """

    def __init__(self, threads: int = 1, card: bool = False) -> None:
        if not card:
            os.environ["CUDA_VISIBLE_DEVICES"] = ""
        limit_threads(threads)
        # All jobs run on the same thread, since an OpenGL context belongs to the thread that created it.
        self._thread = ThreadPoolExecutor(1, initializer=limit_threads, initargs=(threads,))
        self._run: JobRunner[Any] | None = None

    def check(self, expected: dict[str, str]) -> str:
        """Check that this machine has the main process's versions of all packages.

        A plugin's package that is not installed here is no error; a job that needs it will raise one.

        Args:
            expected: the `package_versions` of the main process.

        Returns:
            The name of this machine.

        Raises:
            DeuxError: a version differs.
        """
        here = package_versions()
        different = [name for name in expected if here.get(name, expected[name]) != expected[name]]
        if different:
            name = different[0]
            raise DeuxError(
                f"The worker on {socket.gethostname()} has {name} {here[name]}, but the main process has "
                f"{name} {expected[name]}: install the same versions on all machines of the cluster."
            )
        return socket.gethostname()

    def load(self, run: JobRunner[Any]) -> None:
        """Set the job runner, which contains the depth model."""
        self._run = run

    def run(self, job: Job[Any], streamed: bool) -> Iterator[JobPart]:
        """Run a job.

        Args:
            job: the job.
            streamed: whether to send files in the parts; otherwise they are written to the plans' folders.

        Yields:
            The new results, about twice a second.

        Raises:
            DeuxError: raised by the job's runner.
        """
        if not streamed:
            yield from (JobPart(done) for done in self._counts(job))
            return
        scratch = Path(tempfile.mkdtemp(prefix="deux-"))
        try:
            folders = [scratch / str(number) for number in range(len(job.plans))]
            pairs = zip(job.plans, folders, strict=True)
            local = Job(tuple(replace(plan, folder=folder) for plan, folder in pairs))
            for done in self._counts(local):
                parts = [JobPart(0, files) for files in _take_files(folders)]
                yield from parts[:-1]
                yield JobPart(done, parts[-1].files if parts else ())
        finally:
            shutil.rmtree(scratch, ignore_errors=True)

    def _counts(self, job: Job[Any]) -> Iterator[int]:
        """Run a job; yield the new progress at intervals, and once at the end."""
        assert self._run is not None
        done: SimpleQueue[int] = SimpleQueue()
        task = self._thread.submit(self._run, job, done.put)
        while not task.done():
            wait([task], timeout=_SECONDS)
            if not task.done():
                yield _sum(done)
        task.result()
        yield _sum(done)


def _take_files(folders: Sequence[Path]) -> Iterator[tuple[SentFile, ...]]:
    """Remove and yield the finished files of plans, so that a frame's pose and an episode's record come last.

    An episode's record is written after its other files, and a frame's pose after the frame's other files. Listing
    records first, then poses, then all others, and sending them in the opposite order, ensures that everything that a
    listed record or pose belongs to is sent before it.
    """
    records = [(k, folder / "episode.json") for k, folder in enumerate(folders) if (folder / "episode.json").exists()]
    poses = [(k, path) for k, folder in enumerate(folders) for path in sorted(folder.glob("absolute_pose/[!.]*"))]
    known = {path for _, path in (*records, *poses)}
    rest = [
        (k, path)
        for k, folder in enumerate(folders)
        for path in sorted(folder.rglob("[!.]*"))
        if path not in known and path.parent.name != "absolute_pose" and path.name != "episode.json" and path.is_file()
    ]
    part: list[SentFile] = []
    size = 0
    for k, path in (*rest, *poses, *records):
        content = path.read_bytes()
        path.unlink()
        part.append(SentFile(k, str(path.relative_to(folders[k])), content))
        size += len(content)
        if size >= _PART_BYTES:
            yield tuple(part)
            part, size = [], 0
    yield tuple(part)


def _sum(done: "SimpleQueue[int]") -> int:
    """Empty a queue and return the sum of its values."""
    total = 0
    while True:
        try:
            total += done.get_nowait()
        except Empty:
            return total
