"""Runs jobs in a process of a cluster, and hands over what it has done as it goes."""

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
"""Between two parts of a job's results."""

_PART_BYTES = 32 * 2**20
"""From which size on a part is handed over."""


class SentFile(NamedTuple):
    """A file of a plan, on its way to the process that hands the jobs out.

    Args:
        plan: number of the plan in its job.
        name: path relative to the plan's folder.
        content: all of the file.
    """

    plan: int
    name: str
    content: bytes


class JobPart(NamedTuple):
    """What has been done of a job since the part before.

    Args:
        done: what is newly done, as progress counts it.
        files: files that are finished, to be written in this order; none where they are written in place.
    """

    done: int
    files: tuple[SentFile, ...] = ()


def package_versions() -> dict[str, str]:
    """The versions, by name, that must be the same wherever frames of one dataset are made; those of plugins too."""
    packages = ("deux", "torch", "numpy", "scipy", "numba", "kornia", "opencv-python-headless", "embreex")
    plugins = {plugin.package: plugin.version for kind in KINDS for plugin in registry().plugins(kind)}
    return {"Python": platform.python_version(), **plugins, **{name: version(name) for name in packages}}


class JobWorker:
    """Runs jobs one after the other. The methods are called in the order `check`, `load`, and `run` for each job.

    Args:
        threads: threads that it computes with.
        card: whether a graphics card, or a share of one, is reserved for it; otherwise it uses none.
    """

    def __init__(self, threads: int = 1, card: bool = False) -> None:
        if not card:
            os.environ["CUDA_VISIBLE_DEVICES"] = ""
        limit_threads(threads)
        # Jobs run on one thread of their own, as an OpenGL context belongs to the thread that made it.
        self._thread = ThreadPoolExecutor(1, initializer=limit_threads, initargs=(threads,))
        self._run: JobRunner[Any] | None = None

    def check(self, expected: dict[str, str]) -> str:
        """The name of this machine, if its packages are those of the process that hands the jobs out.

        A plugin's package that is missing here is no error: a job that needs it will say so.

        Args:
            expected: the `package_versions` of that process.

        Raises:
            DeuxError: a version differs.
        """
        here = package_versions()
        different = [name for name in expected if here.get(name, expected[name]) != expected[name]]
        if different:
            name = different[0]
            raise DeuxError(
                f"The worker on {socket.gethostname()} has {name} {here[name]}, but the process that hands out the "
                f"jobs has {name} {expected[name]}: install the same versions on all machines of the cluster."
            )
        return socket.gethostname()

    def load(self, run: JobRunner[Any]) -> None:
        """Keep what runs the jobs, the depth model included."""
        self._run = run

    def run(self, job: Job[Any], streamed: bool) -> Iterator[JobPart]:
        """Run a job.

        Args:
            job: its plans.
            streamed: whether files are handed over in the parts; otherwise they are written to the plans' folders.

        Yields:
            What has been done, about twice a second.

        Raises:
            DeuxError: as the job's runner.
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
        """Run a job; yield now and then, and once at the end, what was done since the last time."""
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
    """Take the finished files of plans out of their folders, in an order that tells when a frame is complete.

    An episode's record is written after everything else of it, a frame's pose after all else of the frame. Records
    are looked for first, then poses, then the rest, and sent the other way round: what makes a record or a pose count
    is sent before it.
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
    total = 0
    while True:
        try:
            total += done.get_nowait()
        except Empty:
            return total
