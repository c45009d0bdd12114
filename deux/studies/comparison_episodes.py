"""The episodes of a comparison: every explorer in every scene, from the same places, each kept when it is over."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from operator import attrgetter
from pathlib import Path

from deux.collection.episodes import count_floors
from deux.collection.local_execution import prepare_process
from deux.collection.perception import MODEL_NEEDS, Perception
from deux.collection.specification import episode_seed, place_name
from deux.collection.walk import Walk, run_walks
from deux.contracts import SceneReference, Simulator
from deux.errors import DeuxError
from deux.geometry.poses import yaw_of
from deux.inference.threads import one_thread
from deux.io.atomic import make_folder, read_bytes, write_json
from deux.io.processes import in_processes
from deux.io.progress import Progress, ignore_progress
from deux.registry import PluginChoice
from deux.simulator.simulation import Simulation
from deux.studies.exploration_meter import Exploration, Track, measure_exploration
from deux.studies.explorer_comparison import ExplorationEpisode
from deux.studies.participants import RewardStates, make_rewards


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
    processes: int = 1,
    progress: Progress = ignore_progress,
) -> list[ExplorationEpisode]:
    """Run the episodes that are not in the folder yet, and return all: by explorer, then by scene.

    Args:
        folder: where each episode is kept in a file of its own when it is over.
        simulation: makes the simulators.
        scenes: where the episodes take place; each is loaded once in a process.
        explorers: who takes part.
        rewards: the rewards that judge all of them.
        seed: the run's; the seed of an episode is `episode_seed`, the same for all explorers.
        steps: actions in an episode.
        episodes: episodes of each explorer on each floor of each scene; a scene has one floor unless its `area` asks
            for all.
        perception: the depth model, for the explorers that need one; loaded once in a process.
        processes: processes of this machine that explore at the same time, each scene in one of them. What they measure
            is the same for any number, the time that an episode takes apart.
        progress: told the number of episodes.

    Raises:
        DeuxError: a scene cannot be read, an explorer needs a model and there is none, the disk is full, a process has
            died, or the file of an episode is damaged.
    """
    make_folder(folder)
    floors = {scene.name: count_floors(scene, simulation.make) for scene in scenes}
    plan = _Plan(folder, simulation, rewards, seed, steps, episodes, floors)
    records = [
        plan.record(choice, scene, floor, number)
        for choice in explorers
        for scene in scenes
        for floor, number in plan.numbers(scene)
    ]

    def report(_: int = 0) -> None:
        progress("episodes", sum(record.exists() for record in records), len(records))

    report()
    work = partial(_explore_scene, plan=plan, explorers=explorers, perception=perception)
    unfinished = [scene for scene in scenes if plan.unfinished(scene, explorers)]
    processes = min(processes, len(unfinished))
    if processes > 1:
        in_processes(work, unfinished, processes, report, attrgetter("name"), prepare_process(processes))
    else:
        for scene in unfinished:
            work(scene, report)
    return [_read(record) for record in records]


@dataclass(frozen=True)
class _Plan:
    """What the episodes have in common, as `compare_explorers` says; it travels to other processes."""

    folder: Path
    simulation: Simulation
    rewards: RewardStates
    seed: int
    steps: int
    episodes: int
    floors: Mapping[str, int]
    """The number of floors of each scene, by the scene's name."""

    def numbers(self, scene: SceneReference) -> list[tuple[int, int]]:
        """The floor and the number of each of an explorer's episodes in a scene."""
        return list(product(range(self.floors[scene.name]), range(self.episodes)))

    def record(self, explorer: PluginChoice, scene: SceneReference, floor: int, number: int) -> Path:
        """The file of an episode; it is there when the episode is over."""
        return self.folder / f"{explorer.name}-{place_name(scene, floor)}-{number:02d}.json"

    def unfinished(
        self, scene: SceneReference, explorers: Sequence[PluginChoice]
    ) -> list[tuple[PluginChoice, int, int]]:
        """The episodes of a scene, by explorer, floor and number, that are not over."""
        return [
            (choice, floor, number)
            for choice in explorers
            for floor, number in self.numbers(scene)
            if not self.record(choice, scene, floor, number).exists()
        ]


def _explore_scene(
    scene: SceneReference,
    count: Callable[[int], None],
    plan: _Plan,
    explorers: Sequence[PluginChoice],
    perception: Perception | None,
) -> None:
    """Run the unfinished episodes of some explorers in one scene, which is loaded once."""
    simulator = plan.simulation.make(scene)
    for choice, floor, number in plan.unfinished(scene, explorers):
        with one_thread():  # or the depth model's last bits would depend on the number of threads
            episode = _explore(plan, choice, simulator.another(), scene, floor, number, perception)
        write_json(plan.record(choice, scene, floor, number), asdict(episode))
        count(1)


def _explore(
    plan: _Plan,
    choice: PluginChoice,
    simulator: Simulator,
    scene: SceneReference,
    floor: int,
    number: int,
    perception: Perception | None,
) -> ExplorationEpisode:
    """Run one episode and measure it."""
    began = time.perf_counter()
    seed = episode_seed(plan.seed, scene, number)
    explorer = choice.create()
    walk = Walk(simulator, explorer, seed, plan.steps, floor)
    track = Track()
    for (step,) in run_walks([walk], perception if explorer.needs & MODEL_NEEDS else None):
        track.add(step.frame.pose, step.collided, step.action)
    exploration = measure_exploration(simulator, track, make_rewards(plan.rewards), seed, plan.steps, floor)
    trajectory = [(float(pose[0, 3]), float(pose[2, 3]), yaw_of(pose)) for pose in track.poses]
    seconds = round(time.perf_counter() - began, 2)
    return ExplorationEpisode(choice.name, scene.name, number, seed, exploration, trajectory, seconds, floor)


def _read(record: Path) -> ExplorationEpisode:
    try:
        content = json.loads(read_bytes(record))
        content["exploration"] = Exploration(**content["exploration"])
        content["trajectory"] = [(x, z, yaw) for x, z, yaw in content["trajectory"]]
        return ExplorationEpisode(**content)
    except (ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it holds no episode ({error}): delete it.") from error
