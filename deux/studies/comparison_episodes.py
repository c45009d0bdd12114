"""The episodes of a comparison: every explorer in every scene, from the same places, each kept when it is over."""

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
    """What became of the episodes of a comparison.

    Args:
        episodes: of the explorers that have finished all of theirs, by explorer, then by scene.
        failed: by the names of the other explorers, the files with the stack traces of the episodes that an unexpected
            error has ended.
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
    """Run the episodes that are not in the folder yet, and return all.

    An unexpected error, such as an explorer of another package may raise, ends its episode and no other.

    Args:
        folder: where each episode is kept in a folder of its own when it is over.
        simulation: makes the simulators.
        scenes: where the episodes take place; each is loaded once for the episodes of a job.
        explorers: who takes part.
        rewards: the rewards that judge all of them.
        seed: the run's; the seed of an episode is `episode_seed`, the same for all explorers.
        steps: actions in an episode.
        episodes: episodes of each explorer on each floor of each scene; a scene has one floor unless its `area` asks
            for all.
        perception: the depth model, for the explorers that need one; loaded once in a process.
        execute: hands out the episodes, those of a scene together where it can. What they measure is the same wherever
            they run, the time that an episode takes apart.
        progress: told the number of episodes.

    Raises:
        DeuxError: a scene cannot be read, an explorer needs a model and there is none, the disk is full, a process has
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
    """An episode of one explorer that is to be measured.

    Args:
        folder: where its record is written.
        scene: the scene it takes place in.
        explorer: who explores.
        floor: the floor of the scene, an index into `Simulator.floors`.
        number: number of the explorer's episode there.
    """

    explorer: PluginChoice
    floor: int
    number: int

    @property
    def size(self) -> int:
        """One: progress counts episodes."""
        return 1

    @property
    def record(self) -> Path:
        """The file that is written when the episode is over."""
        return self.folder / "episode.json"

    @property
    def failure(self) -> Path:
        """The file that is written in its place when an unexpected error has ended the episode: the stack trace."""
        return self.folder / "failure.txt"

    @property
    def finished(self) -> bool:
        """Whether the episode is over."""
        return self.record.exists()


@dataclass(frozen=True)
class ComparisonRunner:
    """Runs the episodes of a job one after the other; arguments as of `compare_explorers`."""

    simulation: Simulation
    rewards: RewardStates
    seed: int
    steps: int
    perception: Perception | None = None

    def __call__(self, job: Job[ComparisonPlan], count: Count) -> None:
        """Run and measure a job's episodes.

        Args:
            job: the episodes, those of a scene one after the other: it is loaded once for them.
            count: told of episodes as they end.

        Raises:
            DeuxError: a scene cannot be read, or an explorer needs a model and there is none.
        """
        for scene, plans in groupby(job.plans, key=attrgetter("scene")):
            simulator = self.simulation.make(scene)
            for plan in plans:
                make_folder(plan.folder)
                try:
                    with one_thread():  # or the depth model's last bits would depend on the number of threads
                        episode = self._explore(plan, simulator.another())
                except (DeuxError, OSError, MemoryError):  # of a scene or of the machine
                    raise
                except Exception as error:  # the explorers of other packages may raise anything
                    write_atomically(plan.failure, "".join(traceback.format_exception(error)).encode())
                else:
                    write_json(plan.record, asdict(episode))
                count(1)

    def _explore(self, plan: ComparisonPlan, simulator: Simulator) -> ExplorationEpisode:
        """Run one episode and measure it."""
        began = time.perf_counter()
        scene, floor, number = plan.scene, plan.floor, plan.number
        seed = episode_seed(self.seed, scene, number)
        explorer = plan.explorer.create()
        walk = Walk(simulator, explorer, seed, self.steps, floor)
        track = Track()
        for (step,) in run_walks([walk], self.perception if explorer.needs & MODEL_NEEDS else None):
            track.add(step.frame.pose, step.collided, step.action)
        exploration = measure_exploration(simulator, track, make_rewards(self.rewards), seed, self.steps, floor)
        trajectory = [(float(pose[0, 3]), float(pose[2, 3]), yaw_of(pose)) for pose in track.poses]
        seconds = round(time.perf_counter() - began, 2)
        return ExplorationEpisode(plan.explorer.name, scene.name, number, seed, exploration, trajectory, seconds, floor)


def _read(record: Path) -> ExplorationEpisode:
    try:
        content = json.loads(read_bytes(record))
        content["exploration"] = Exploration(**content["exploration"])
        content["trajectory"] = [(x, z, yaw) for x, z, yaw in content["trajectory"]]
        return ExplorationEpisode(**content)
    except (ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it holds no episode ({error}): delete it.") from error
