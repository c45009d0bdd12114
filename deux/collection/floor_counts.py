"""Counts the floors of scenes whose episodes take place on all floors; each scene is loaded once."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from deux.collection.episodes import MakeSimulator
from deux.collection.jobs import Executor, Job, Plan, run_here, run_unfinished
from deux.contracts import SceneReference
from deux.io.atomic import make_folder, write_json
from deux.io.processes import Count
from deux.io.progress import Progress, ignore_progress


@dataclass(frozen=True)
class FloorsPlan(Plan):
    """A scene whose floors to count."""

    @property
    def size(self) -> int:
        """One: progress counts scenes."""
        return 1

    @property
    def file(self) -> Path:
        """The JSON file with the number of floors."""
        return self.folder / "floors.json"

    @property
    def finished(self) -> bool:
        """Whether they have been counted."""
        return self.file.exists()


@dataclass(frozen=True)
class FloorCounter:
    """Counts the floors of a job's scenes.

    Args:
        make_simulator: creates the simulator of a scene.
    """

    make_simulator: MakeSimulator

    def __call__(self, job: Job[FloorsPlan], count: Count) -> None:
        """Load each scene and write the number of its floors.

        Raises:
            DeuxError: a scene cannot be loaded.
        """
        for plan in job.plans:
            make_folder(plan.folder)
            write_json(plan.file, len(self.make_simulator(plan.scene).floors))
            count(1)


def count_all_floors(
    scenes: Sequence[SceneReference],
    folder: Path,
    make_simulator: MakeSimulator,
    execute: Executor = run_here,
    progress: Progress = ignore_progress,
) -> Mapping[str, int]:
    """The number of floors on which episodes take place, by the name of the scene.

    Only scenes whose `area` selects all floors are loaded, unless an earlier call has counted their floors.

    Args:
        scenes: scenes with different names.
        folder: where the counts are stored, in a folder for each scene; use it only for these scenes and areas and this
            simulator.
        make_simulator: creates the simulator of a scene.
        execute: runs the jobs.
        progress: called with the number of scenes.

    Raises:
        DeuxError: a scene cannot be loaded.
    """
    plans = [FloorsPlan(folder / scene.name, scene) for scene in scenes if scene.area.floor == "all"]
    run_unfinished("floors", FloorCounter(make_simulator), [Job((plan,)) for plan in plans], execute, progress)
    counted = {plan.scene.name: int(json.loads(plan.file.read_bytes())) for plan in plans}
    return {scene.name: counted.get(scene.name, 1) for scene in scenes}
