"""Long runs in one process that tell how much memory they use: a program, so that each has a process of its own.

    python tests/long_runs.py frames|rounds|jobs NUMBER FOLDER

It prints a line "<done> <MiB> <files> <threads>" whenever a further share of the work is done: memory that belongs to
the process alone, and the files and threads that it has open.
"""

import importlib.util
import logging
import os
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from hydra.experimental.callback import Callback
from lightning.pytorch.loggers import CSVLogger

sys.path.append(str(Path(__file__).resolve().parent / "collection"))

from toy_world import CAMERA, SIMULATION, ToySimulator, Wanderer, specification

from deux.collection.pipeline import build_dataset
from deux.contracts import Action, Observation

SHARES = 20
"""Number of times that a run tells its memory."""


def own_memory() -> float:
    """MiB that this process alone uses, files that are mapped into it left out."""
    status = Path("/proc/self/status").read_text()
    found = re.search(r"RssAnon:\s+(\d+) kB", status)
    assert found is not None
    return int(found[1]) / 1024


class Meter:
    """Prints the memory at each share of the work."""

    def __init__(self, total: int) -> None:
        self._every = max(1, total // SHARES)
        self._told = 0

    def __call__(self, done: int) -> None:
        if done >= self._told + self._every:
            self._told = done
            files, threads = (len(os.listdir(f"/proc/self/{kind}")) for kind in ("fd", "task"))
            print(done, round(own_memory(), 1), files, threads, flush=True)


class Forgetful(Wanderer):
    """Keeps nothing of what it has seen."""

    def act(self, observation: Observation) -> Action:
        self.seen.clear()
        return super().act(observation)


def frames(number: int, folder: Path) -> None:
    """Collect so many frames, in two scenes with five episodes each."""
    meter = Meter(number)
    simulation = replace(SIMULATION, camera=replace(CAMERA, width=24, height=20))
    spec = specification(simulation=simulation, steps=number // 10, episodes=5)

    def simulator(scene: Any) -> ToySimulator:
        return ToySimulator(scene, simulation.camera)

    def report(stage: str, done: int, total: int) -> None:
        if stage == "exploration":
            meter(done)
        elif done == total:
            print(f"# {stage} {total}: {own_memory():.1f} MiB", flush=True)

    build_dataset(spec, folder, simulator, Forgetful, progress=report)


def rounds(number: int, folder: Path) -> None:
    """Train with so many rounds of active collection, each of which replaces the frames of the one before."""
    active_run = _module(Path(__file__).resolve().parent / "training" / "active_run.py")
    meter, collect = Meter(number), active_run.collect_in(folder / "rounds", [])

    def metered(request: Any) -> Any:
        found = collect(request)
        meter(request.number)
        return found

    steps = {"steps": 3 * (number + 1)}
    logger = CSVLogger(folder, "logs", "version_0")
    active_run.train(folder, steps, {"rounds": number, "mode": "replace"}, {"logger": logger}, collect=metered)


class JobMeter(Callback):
    """Tells the memory after each job of a sweep; Hydra makes it."""

    def __init__(self, total: int) -> None:
        self._meter, self._done = Meter(total), 0

    def on_job_end(self, **_: Any) -> None:
        self._done += 1
        self._meter(self._done)


def jobs(number: int, folder: Path) -> None:
    """Run a sweep of so many jobs by Hydra's basic launcher, each of which collects a dataset of its own."""
    from deux.__main__ import main

    sys.modules["long_runs"] = sys.modules[__name__]
    callback = [f"+hydra.callbacks.memory={{_target_:long_runs.JobMeter,total:{number}}}"]
    # One flat and as many starts in it.
    scene = ["scenes.train=1", "scenes.test=0", "collect.steps=4", "verification.min_distance=0.0"]
    settings = ["experiment=smallest", "task=collect", "explore=random", *scene, f"paths.outputs={folder}"]
    sys.argv = ["deux", "-m", *settings, *callback, f"seed=range({number})"]
    main()


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


RUNS: dict[str, Callable[[int, Path], None]] = {"frames": frames, "rounds": rounds, "jobs": jobs}

if __name__ == "__main__":
    torch.set_num_threads(1)
    np.seterr(all="raise", under="ignore")
    logging.basicConfig(level=logging.ERROR)
    run, count, folder = sys.argv[1:]
    RUNS[run](int(count), Path(folder))
