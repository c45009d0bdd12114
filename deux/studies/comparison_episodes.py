"""Runs the episodes of a comparison of explorers and saves each to a file when it is finished."""

import json
import time
import traceback
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby, product
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from deux.collection.floor_counts import count_all_floors
from deux.collection.jobs import Executor, Job, Plan, run_here, run_unfinished
from deux.collection.perception import MODEL_NEEDS, Perception
from deux.collection.specification import episode_seed, place_name
from deux.collection.walk import Walk, run_walks
from deux.contracts import SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.poses import yaw_of
from deux.inference.threads import one_thread
from deux.io.atomic import make_folder, read_bytes, write_atomically, write_json
from deux.io.processes import Count
from deux.io.progress import Progress, ignore_progress
from deux.registry import PluginChoice
from deux.simulator.simulation import Simulation
from deux.studies.exploration_meter import Exploration, Track, measure_exploration
from deux.studies.explorer_comparison import ExplorationEpisode
from deux.studies.participants import RewardStates, make_rewards


class ComparedEpisodes(NamedTuple):
    """The results of a comparison.

    Args:
        episodes: episodes of the explorers without failures, ordered by explorer, then by scene.
        failed: files with the stack traces of the failed episodes, by name of the other explorers.
    """

    episodes: list[ExplorationEpisode]
    failed: dict[str, list[Path]]


def compare_explorers(
    folder: Path,
    simulation: Simulation,
    scenes: Sequence[SceneReference],
    explorers: Sequence[PluginChoice],
    rewards: RewardStates,
    seed: int,
    steps: int,
    episodes: int = 1,
    perception: Perception | None = None,
    execute: Executor = run_here,
    progress: Progress = ignore_progress,
) -> ComparedEpisodes:
    """Run the episodes that are not finished yet, and return all.

    Every explorer explores every scene, from the same start poses. An unexpected error, such as from a third-party
    explorer, ends only its own episode.

    Args:
        folder: folder of the episodes' subfolders.
        simulation: creates the simulators.
        scenes: the scenes; each is loaded once for the episodes of a job.
        explorers: the explorers.
        rewards: states of the rewards that are computed for all explorers.
        seed: seed of the run; the seed of an episode is `episode_seed`, the same for all explorers.
        steps: actions per episode.
        episodes: episodes per explorer, scene and floor; scenes have one floor unless their `area` includes all.
        perception: depth model and uncertainty, for explorers that need them.
        execute: distributes the jobs, which consist of the episodes of a scene if possible. Except for the duration of
            episodes, the results do not depend on it.
        progress: called with the number of finished episodes.

    Raises:
        DeuxError: a scene cannot be read, an explorer needs a model and there is none, the disk is full, a process
            died, or the file of an episode is damaged.
    """
    floors = count_all_floors(scenes, folder / "floors", simulation.make, execute)
    plans = {
        (choice.name, scene.name): [
            ComparisonPlan(
                folder / f"{choice.name}-{place_name(scene, floor)}-{number:02d}", scene, choice, floor, number
            )
            for floor, number in product(range(floors[scene.name]), range(episodes))
        ]
        for choice in explorers
        for scene in scenes
    }
    jobs = [
        Job(tuple(plan for choice in explorers for plan in plans[choice.name, scene.name]), divisible=True)
        for scene in scenes
    ]
    ordered = [plan for group in plans.values() for plan in group]
    progress("episodes", sum(plan.finished for plan in ordered), len(ordered))
    run_unfinished("episodes", ComparisonRunner(simulation, rewards, seed, steps, perception), jobs, execute, progress)
    failed: dict[str, list[Path]] = defaultdict(list)
    for plan in ordered:
        if not plan.finished:
            failed[plan.explorer.name].append(plan.failure)
    return ComparedEpisodes([_read(plan.record) for plan in ordered if plan.explorer.name not in failed], {**failed})


@dataclass(frozen=True)
class ComparisonPlan(Plan):
    """An episode to be run.

    Args:
        folder: folder of its files.
        scene: its scene.
        explorer: its explorer.
        floor: floor of the scene, an index into `Simulator.floors`.
        number: number of the episode on this floor.
    """

    explorer: PluginChoice
    floor: int
    number: int

    @property
    def size(self) -> int:
        """1, since progress counts episodes."""
        return 1

    @property
    def record(self) -> Path:
        """File of the finished episode."""
        return self.folder / "episode.json"

    @property
    def failure(self) -> Path:
        """File of the stack trace of a failed episode."""
        return self.folder / "failure.txt"

    @property
    def finished(self) -> bool:
        """Whether the episode is finished."""
        return self.record.exists()


@dataclass(frozen=True)
class ComparisonRunner:
    """Runs the episodes of a job one after the other; the arguments are those of `compare_explorers`."""

    simulation: Simulation
    rewards: RewardStates
    seed: int
    steps: int
    perception: Perception | None = None

    def __call__(self, job: Job[ComparisonPlan], count: Count) -> None:
        """Run the episodes of a job.

        Args:
            job: the episodes, ordered by scene; each scene is loaded once.
            count: called with the number of newly finished episodes.

        Raises:
            DeuxError: a scene cannot be read, or an explorer needs a model and there is none.
        """
        for scene, plans in groupby(job.plans, key=attrgetter("scene")):
            simulator = self.simulation.make(scene)
            for plan in plans:
                make_folder(plan.folder)
                try:
                    with one_thread():  # otherwise the last bits of depth would depend on the number of threads
                        episode = self._explore(plan, simulator.another())
                except (DeuxError, OSError, MemoryError):  # not the explorer's fault
                    raise
                except Exception as error:  # third-party explorers may raise anything
                    write_atomically(plan.failure, "".join(traceback.format_exception(error)).encode())
                else:
                    write_json(plan.record, asdict(episode))
                count(1)

    def _explore(self, plan: ComparisonPlan, simulator: Simulator) -> ExplorationEpisode:
        """Run one episode and measure it."""
        started = time.perf_counter()
        scene, floor, number = plan.scene, plan.floor, plan.number
        seed = episode_seed(self.seed, scene, number)
        explorer = plan.explorer.create()
        walk = Walk(simulator, explorer, seed, self.steps, floor)
        track = Track()
        for (step,) in run_walks([walk], self.perception if explorer.needs & MODEL_NEEDS else None):
            track.add(step.frame.pose, step.collided, step.action)
        exploration = measure_exploration(simulator, track, make_rewards(self.rewards), seed, self.steps, floor)
        trajectory = [(float(pose[0, 3]), float(pose[2, 3]), yaw_of(pose)) for pose in track.poses]
        seconds = round(time.perf_counter() - started, 2)
        return ExplorationEpisode(plan.explorer.name, scene.name, number, seed, exploration, trajectory, seconds, floor)


def _read(record: Path) -> ExplorationEpisode:
    try:
        content = json.loads(read_bytes(record))
        content["exploration"] = Exploration(**content["exploration"])
        content["trajectory"] = [(x, z, yaw) for x, z, yaw in content["trajectory"]]
        return ExplorationEpisode(**content)
    except (ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it is not an episode ({error}): delete it.") from error
