"""`collect.executor=ray`: jobs on a Ray cluster (https://docs.ray.io)."""

import logging
import os
import shutil
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from deux.collection.job_worker import JobPart, JobWorker, package_versions
from deux.collection.jobs import Job, JobRunner, P, share_out
from deux.collection.ray_cluster import connected, ray, room
from deux.collection.ray_scenes import SceneSender
from deux.errors import DeuxError, check_range
from deux.io.atomic import make_folder, write_atomically
from deux.io.processes import Count

log = logging.getLogger(__name__)

_PARTS_AHEAD = 8
"""Number of result parts that a worker may produce before this process has read them."""

_PATIENCE = 30.0
"""Seconds without any ready worker after which a warning is logged."""

_VISIBLE_AFTER = 60.0
"""Seconds within which files that another machine wrote to shared storage must become visible here."""


class RayExecutor:
    """Runs jobs on a Ray cluster, whose workers load the depth model once and run one job after the other.

    If a worker or its machine dies, it is replaced and its job is run again. The frames are the same as those of a
    single process. All machines need the same versions of packages. Scenes in files of this machine are sent once to
    each other machine, but simulators that read files themselves (habitat) need shared storage.

    Args:
        address: the cluster: null starts a temporary one on this machine, "auto" uses the one that this machine joined
            by `ray start`; or the host:port of the head node.
        workers: number of processes; null for as many as fit on the cluster.
        cpus: CPU cores, and threads, of each worker.
        gpus: share of a GPU that each worker reserves: with 0.25, four workers share a GPU.
        results: "streamed" sends frames to this process, which writes them; "shared" lets the workers write to the
            dataset's folder, which must have the same path on all machines.
        attempts: number of workers that may die running the same job before collection ends with an error.

    Raises:
        DeuxError: a value is out of its range.
    """

    def __init__(
        self,
        address: str | None = None,
        workers: int | None = None,
        cpus: int = 1,
        gpus: float = 0.0,
        results: Literal["streamed", "shared"] = "streamed",
        attempts: int = 3,
    ) -> None:
        where = "collect.executor_options"
        if address is not None and "://" in address:
            raise DeuxError(f"{where}.address is {address!r}: it must be null, auto or the host:port of the head node.")
        if workers is not None:
            check_range(f"{where}.workers", workers, 1)
        check_range(f"{where}.cpus", cpus, 1)
        check_range(f"{where}.gpus", gpus, 0.0)
        check_range(f"{where}.attempts", attempts, 1)
        self.address, self.workers, self.cpus, self.gpus = address, workers, cpus, gpus
        self.results, self.attempts = results, attempts

    def __call__(self, run: JobRunner[P], jobs: Sequence[Job[P]], count: Count) -> None:
        """Run all jobs; see `deux.collection.jobs.Executor`.

        Raises:
            DeuxError: there is no such cluster or no room on it, a job failed, or too many workers died running it.
        """
        if not jobs:
            return
        with connected(self.address):
            collection = _Collection(self, run, jobs, count)
            try:
                collection.run()
            finally:
                collection.close()


@dataclass(eq=False)
class _Task:
    """A job and its progress.

    Args:
        job: the job.
        attempts: number of workers that have started it.
        done: progress of the current attempt.
        counted: progress reported so far: the maximum over all attempts.
        known: for each plan, whether it was finished before the current attempt.
    """

    job: Job[Any]
    attempts: int = 0
    done: int = 0
    counted: int = 0
    known: tuple[bool, ...] = ()

    def __str__(self) -> str:
        return str(self.job)

    def begin(self, streamed: bool) -> None:
        """Start a new attempt; with streamed results, unfinished plans start anew: workers cannot see their files."""
        self.attempts += 1
        self.done = 0
        self.known = tuple(plan.finished for plan in self.job.plans)
        for plan, known in zip(self.job.plans, self.known, strict=True):
            if streamed and not known:  # on another CPU the robot may take another path
                shutil.rmtree(plan.folder, ignore_errors=True)

    def add(self, part: JobPart) -> int:
        """Write a part's files; return the progress beyond that of all attempts so far."""
        for plan, name, content in part.files:
            if not self.known[plan]:
                path = self.job.plans[plan].folder / name
                make_folder(path.parent)
                write_atomically(path, content)
        self.done += part.done
        new = max(0, self.done - self.counted)
        self.counted += new
        return new


@dataclass(eq=False)
class _Worker:
    """This process's view of a worker.

    Args:
        actor: Ray actor of `JobWorker`.
        checked: reference to the result of `check`, its machine's name.
        awaited: reference to the result of `load`, then to the next part of its job; None if it is idle.
        machine: the name of its machine, once it has started.
        task: its current task.
    """

    actor: Any
    checked: Any
    awaited: Any
    machine: str | None = None
    task: _Task | None = None


class _Collection:
    """Distributes jobs to workers until all are done; arguments as for `RayExecutor.__call__`."""

    def __init__(self, settings: RayExecutor, run: JobRunner[Any], jobs: Sequence[Job[Any]], count: Count) -> None:
        self._settings, self._count = settings, count
        self._streamed = settings.results == "streamed"
        there = room(settings.cpus, settings.gpus)
        if not there and settings.workers is None:
            raise DeuxError(
                f"The Ray cluster has no machine with {settings.cpus} CPUs and {settings.gpus:g} graphics cards, which "
                "collect.executor_options requires for each worker."
            )
        workers = settings.workers or there
        if not settings.gpus:  # on a GPU, which this process may lack, larger batches are faster
            jobs = share_out(jobs, workers, count)
        self._most = min(workers, len(jobs))
        self._run = ray.put(run)
        self._versions = package_versions()
        self._scenes = SceneSender([plan.scene for job in jobs for plan in job.plans])
        self._tasks = deque(_Task(job) for job in jobs)
        self._workers: list[_Worker] = []
        self._never_started = 0
        self._last_ready = time.monotonic()

    def run(self) -> None:
        """Run until all jobs are done."""
        while self._tasks or self._at_work:
            self._start_workers()
            awaited = {worker.awaited: worker for worker in self._workers if worker.awaited is not None}
            ready, _ = ray.wait(list(awaited), timeout=1.0)
            for reference in ready:
                worker = awaited[reference]
                try:
                    self._receive(worker)
                except ray.exceptions.RayTaskError as error:
                    if isinstance(error.cause, DeuxError):
                        raise DeuxError(str(error.cause)) from None
                    if not isinstance(error.cause, ray.exceptions.RayError):
                        raise
                    self._lose(worker, error.cause)
                except ray.exceptions.RayError as error:
                    self._lose(worker, error)
            self._warn_without_workers(bool(ready))

    def close(self) -> None:
        """End all workers."""
        for worker in self._workers:
            ray.kill(worker.actor)
        self._scenes.close()

    @property
    def _at_work(self) -> int:
        return sum(worker.task is not None for worker in self._workers)

    def _start_workers(self) -> None:
        """Give waiting jobs to idle workers, and start new workers for the others."""
        for worker in self._workers:
            if self._tasks and worker.awaited is None:
                self._next_task(worker)
        for _ in range(min(self._most, self._at_work + len(self._tasks)) - len(self._workers)):
            settings = self._settings
            kind = ray.remote(JobWorker).options(num_cpus=settings.cpus, num_gpus=settings.gpus, max_restarts=0)
            actor: Any = kind.remote(settings.cpus, settings.gpus > 0)
            checked = actor.check.remote(self._versions)
            self._workers.append(_Worker(actor, checked, actor.load.remote(self._run)))

    def _receive(self, worker: _Worker) -> None:
        """Process a worker's result, and give it its next job if it has finished one.

        Raises:
            RayError: it has failed or died.
        """
        if worker.task is None:
            worker.machine = ray.get(worker.checked)
            ray.get(worker.awaited)
            self._never_started = 0
            self._next_task(worker)
            return
        try:
            part: JobPart = ray.get(next(worker.awaited))
        except StopIteration:
            self._finish(worker.task)
            self._next_task(worker)
        else:
            self._count(worker.task.add(part))

    def _next_task(self, worker: _Worker) -> None:
        """Give a worker the next job; without one it stays idle, to replace other workers that die."""
        if not self._tasks:
            worker.task = worker.awaited = None
            return
        worker.task = self._tasks.popleft()
        worker.task.begin(self._streamed)
        plans = (replace(plan, scene=self._scenes.sent(plan.scene)) for plan in worker.task.job.plans)
        streaming = worker.actor.run.options(num_returns="streaming", _generator_backpressure_num_objects=_PARTS_AHEAD)
        worker.awaited = streaming.remote(Job(tuple(plans)), self._streamed)

    def _finish(self, task: _Task) -> None:
        until = time.monotonic() + _VISIBLE_AFTER
        while not task.job.finished:
            if time.monotonic() > until:
                raise DeuxError(
                    f"A worker has finished {task}, but its files have not appeared in {task.job.plans[0].folder}: "
                    "that is not shared storage, so set collect.executor_options.results=streamed."
                )
            for plan in task.job.plans:  # listing a folder makes NFS look for new files
                os.listdir(plan.folder.parent)
            time.sleep(0.5)
        for plan in task.job.plans:
            self._scenes.done(plan.scene)

    def _lose(self, worker: _Worker, error: ray.exceptions.RayError) -> None:
        """A worker is gone: its job goes to another one, if it has not cost too many already."""
        self._workers.remove(worker)
        ray.kill(worker.actor)  # it may be cut off and still running
        task = worker.task
        if task is None:
            self._never_started += 1
            log.info("A worker has died before it was ready: %s", error)
            if self._never_started >= self._settings.attempts:
                reason = str(error).splitlines()[0].rstrip(".")
                raise DeuxError(f"No worker starts on the Ray cluster: {reason}.")
            return
        if task.attempts >= self._settings.attempts:
            raise DeuxError(
                f"{task.attempts} workers died running {task}, the last one on {worker.machine}: if memory ran out, "
                "run fewer on each machine by raising collect.executor_options.cpus; finished work is kept."
            )
        log.warning("The worker on %s is lost; %s is run again.", worker.machine, task)
        log.info("The worker on %s is lost: %s", worker.machine, error)
        self._tasks.appendleft(task)

    def _warn_without_workers(self, received: bool) -> None:
        """Log a warning if no worker has been ready for some time."""
        if received or self._at_work:
            self._last_ready = time.monotonic()
        elif time.monotonic() - self._last_ready > _PATIENCE:
            there = room(self._settings.cpus, self._settings.gpus)
            log.warning("No worker is ready yet: the Ray cluster has room for %d if nothing else runs there.", there)
            self._last_ready = time.monotonic() + 20 * _PATIENCE
