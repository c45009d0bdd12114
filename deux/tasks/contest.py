"""The episodes of a comparison: every explorer in every scene, from the same places, each kept when it is over."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from deux.collection.exploration import MODEL_NEEDS
from deux.collection.perception import SOURCES, Percept
from deux.collection.specification import episode_seed
from deux.collection.walk import Walk
from deux.contracts import Frame, Robot, SceneReference
from deux.environment.scene_pool import ScenePool
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.geometry.poses import yaw_of
from deux.io.atomic import make_folder, read_bytes, write_json
from deux.io.processes import in_processes
from deux.io.progress import Progress
from deux.simulator.mesh_simulator import MeshSimulator
from deux.studies.exploration_meter import Exploration, ExplorationMeter
from deux.studies.explorer_comparison import ExplorationEpisode
from deux.studies.eye import Eye, SceneEye
from deux.tasks.contenders import RewardStates, make_rewards
from deux.tasks.settings import PluginChoice

Perception = Callable[[list[list[Frame]]], list[Percept]]
"""What a depth model makes of the latest frames, newest first, of each of several robots."""


@dataclass(frozen=True)
class Contest:
    """What the episodes have in common; it travels to other processes.

    Args:
        folder: where the finished episodes are kept.
        explorers: who takes part.
        rewards: what judges them.
        camera: the camera that the explorers see by.
        robot: their body.
        renderer: the renderer's name.
        seed: the run's.
        steps: actions in an episode.
        seeds: episodes in a scene.
    """

    folder: Path
    explorers: tuple[PluginChoice, ...]
    rewards: RewardStates
    camera: Camera
    robot: Robot
    renderer: str
    seed: int
    steps: int
    seeds: int

    def record(self, explorer: PluginChoice, scene: SceneReference, number: int) -> Path:
        """The file of an episode; it is there when the episode is over."""
        return self.folder / f"{explorer.name}-{scene.name}-{number:02d}.json"


def hold_contest(
    contest: Contest,
    scenes: Sequence[SceneReference],
    perception: Perception | None,
    processes: int,
    progress: Progress,
) -> list[ExplorationEpisode]:
    """Run the episodes that are not there yet, and return all: by explorer, then by scene.

    Args:
        contest: what they have in common.
        scenes: where they take place.
        perception: of the depth model; for the explorers that need one, which run in this process.
        processes: that the other explorers run in, each scene in one of them.
        progress: told the number of episodes.

    Raises:
        DeuxError: a scene cannot be read, the disk is full, or the file of an episode is damaged.
    """
    make_folder(contest.folder)
    records = [
        contest.record(e, s, number) for e in contest.explorers for s in scenes for number in range(contest.seeds)
    ]

    def report(_: object = None) -> None:
        progress("episodes", sum(record.exists() for record in records), len(records))

    guided = tuple(choice for choice in contest.explorers if choice.create().needs & MODEL_NEEDS)
    alone = tuple(choice for choice in contest.explorers if choice not in guided)
    explore = partial(_explore_scene, contest=contest, explorers=alone)
    report()
    if processes > 1:
        in_processes(explore, [scene for scene in scenes if _unfinished(contest, alone, scene)], processes, report)
    for scene in scenes:
        explore(scene, report=report)
        _explore_scene(scene, contest, guided, perception, report)
    return [_read(record) for record in records]


def _unfinished(
    contest: Contest, explorers: Sequence[PluginChoice], scene: SceneReference
) -> list[tuple[PluginChoice, int]]:
    episodes = [(choice, number) for choice in explorers for number in range(contest.seeds)]
    return [episode for episode in episodes if not contest.record(episode[0], scene, episode[1]).exists()]


def _explore_scene(
    scene: SceneReference,
    contest: Contest,
    explorers: Sequence[PluginChoice],
    perception: Perception | None = None,
    report: Callable[[], Any] = lambda: None,
) -> None:
    """Run the unfinished episodes of some explorers in one scene, which is loaded once."""
    unfinished = _unfinished(contest, explorers, scene)
    if not unfinished:
        return
    pool = ScenePool(contest.camera, contest.robot, most=1, renderer=contest.renderer)
    eye = SceneEye(pool.simulator(scene).scene, contest.camera)
    for choice, number in unfinished:
        episode = _explore(contest, choice, pool.simulator(scene), eye, scene, number, perception)
        write_json(contest.record(choice, scene, number), asdict(episode))
        report()


def _explore(
    contest: Contest,
    choice: PluginChoice,
    simulator: MeshSimulator,
    eye: Eye,
    scene: SceneReference,
    number: int,
    perception: Perception | None,
) -> ExplorationEpisode:
    """Run one episode and measure it."""
    began = time.perf_counter()
    seed = episode_seed(contest.seed, scene, number)
    walk = Walk(simulator, choice.create(), seed, contest.steps)
    meter = ExplorationMeter(eye, contest.robot, make_rewards(contest.rewards), seed, contest.steps)
    trajectory: list[tuple[float, float, float]] = []
    history: list[Frame] = []
    while not walk.over:
        frame = walk.frame()
        meter.see(frame.pose, walk.collided)
        trajectory.append((float(frame.pose[0, 3]), float(frame.pose[2, 3]), yaw_of(frame.pose)))
        history = [frame, *history[:SOURCES]]
        walk.act(frame, perception([history])[0] if perception else None)
        if not walk.over:
            meter.acted(walk.actions[-1])
    exploration = meter.result(simulator.free_space())
    seconds = round(time.perf_counter() - began, 2)
    return ExplorationEpisode(choice.name, scene.name, number, seed, exploration, trajectory, seconds)


def _read(record: Path) -> ExplorationEpisode:
    try:
        content = json.loads(read_bytes(record))
        return ExplorationEpisode(**{**content, "exploration": Exploration(**content["exploration"])})
    except (ValueError, TypeError, KeyError) as error:
        raise DeuxError(f"{record} is damaged, it holds no episode ({error}): delete it.") from error
