"""`task=compare_explorers`: every explorer in the same unseen scenes; a table of what they saw, and where they went."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from omegaconf import DictConfig

from deux.collection.perception import perceive
from deux.configuration import run_folder
from deux.contracts import SceneReference
from deux.environment.memory import RESOLUTION
from deux.errors import DeuxError
from deux.figures.drawing import save_figure
from deux.figures.trajectory_grid import Trajectory, draw_trajectory_grid
from deux.geometry.poses import camera_pose
from deux.inference.precision import FastPredictor
from deux.io.atomic import write_atomically, write_json
from deux.mapping.occupancy import OccupancyMap
from deux.report.results import RESULTS_FILE
from deux.scenes.free_space import free_space
from deux.studies.comparison_sheets import gains_sheet, measures_sheet, rewards_sheet
from deux.studies.explorer_comparison import Comparison, ExplorationEpisode
from deux.studies.eye import SceneEye
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.contenders import Contenders, find_contenders
from deux.tasks.contest import Contest, Perception, hold_contest
from deux.tasks.given import given_model, weights_identity
from deux.tasks.run_folder import EPISODES, RunFolder
from deux.tasks.settings import Settings


def run(cfg: DictConfig) -> None:
    """Compare the explorers, from where an earlier attempt in the same folder stopped."""
    quieten_libraries()
    settings = Settings(cfg)
    contenders = find_contenders(settings)
    scenes = settings.splits.test[: settings.compare.flats]
    if settings.compare.figure_scene >= len(scenes):
        raise DeuxError(
            f"compare.figure_scene is {settings.compare.figure_scene}, but there are {len(scenes)} scenes: the first "
            "one is 0."
        )
    perception, model = _perception(settings)
    run = RunFolder(run_folder(), settings.identity | {"contenders": contenders.identity, "seed model": model})
    say(f"Run folder: {run.path}")
    for name, reason in contenders.left_out.items():
        say(f"Without {name}: {reason}")
    say(f"Explore {len(scenes)} scenes with {', '.join(choice.name for choice in contenders.explorers)}")
    contest = Contest(
        folder=run.path / EPISODES,
        explorers=tuple(contenders.explorers),
        rewards=contenders.rewards,
        camera=settings.camera,
        robot=settings.robot,
        renderer=settings.run.renderer,
        seed=settings.seed,
        steps=settings.compare.steps,
        seeds=settings.compare.seeds,
    )
    with run.stage("explore"), progress() as report:
        episodes = hold_contest(contest, scenes, perception, settings.collect.processes, report)
    with run.stage("draw"):
        _draw(settings, scenes[settings.compare.figure_scene], episodes, run)
    _write(settings, contenders, scenes, Comparison(episodes, contenders.own_rewards), run)
    say(f"Tables, episodes and trajectories: {run.path}")


def _perception(settings: Settings) -> tuple[Perception | None, str | None]:
    """What the model of `seed.checkpoint` sees, and what identifies its weights; None without one."""
    checkpoint = settings.seed_model.checkpoint
    if checkpoint is None:
        return None, None
    _, model = given_model(settings.model, checkpoint)
    perception = partial(
        perceive,
        intrinsics=settings.camera.intrinsics,
        predict_depth=FastPredictor(model, settings.trainer.get("accelerator", "auto")),
        sparse=settings.sampling,
        uncertainty=settings.collect.uncertainty,
    )
    return perception, weights_identity(checkpoint)


def _draw(
    settings: Settings, reference: SceneReference, episodes: Sequence[ExplorationEpisode], run: RunFolder
) -> None:
    """Draw each explorer's first episode in one scene."""
    scene = reference.load()
    eye = SceneEye(scene, settings.camera)
    height = scene.floor_height + settings.robot.camera_height
    trajectories = []
    for episode in episodes:
        if (episode.scene, episode.episode) == (reference.name, 0):
            known = OccupancyMap(eye.camera, settings.robot, RESOLUTION)
            for x, z, yaw in episode.trajectory:
                pose = camera_pose(x, height, z, yaw)
                known.update(eye.look(pose).frame.depth, pose)
            title = f"{episode.explorer}: {episode.exploration.area_seen:.0f} m²"
            path = np.array(episode.trajectory)[:, :2]
            trajectories.append(Trajectory(title, path, known.frame, known.cells))
    plan = free_space(scene.mesh, scene.floor_height, settings.robot)
    save_figure(draw_trajectory_grid(plan, trajectories), run.figures / "trajectories.png")


def _write(
    settings: Settings, contenders: Contenders, scenes: Sequence[SceneReference], comparison: Comparison, run: RunFolder
) -> None:
    """Write the tables, results.json last, and print them."""
    amount = f"{len(scenes)} scenes, {settings.compare.seeds} x {settings.compare.steps} steps in each"
    sheets = [measures_sheet(comparison), rewards_sheet(comparison)]
    baseline = settings.compare.baseline
    if baseline in comparison.explorers and len(comparison.explorers) > 1:
        sheets.append(gains_sheet(comparison, baseline))
    left_out = "".join(f"\nWithout {name}: {reason}\n" for name, reason in contenders.left_out.items())
    page = "\n".join([f"# Explorers compared: {amount}", "", *(sheet.markdown() for sheet in sheets)]) + left_out
    write_atomically(run.path / "table.md", page.encode())
    write_atomically(run.path / "table.csv", comparison.table_csv().encode())
    write_atomically(run.path / "episodes.csv", comparison.episodes_csv().encode())
    results: dict[str, Any] = {
        "task": settings.run.task,
        "scenes": [scene.name for scene in scenes],
        "steps": settings.compare.steps,
        "seeds": settings.compare.seeds,
        "seed": settings.seed,
        "explorers": comparison.summary(),
        "own_rewards": contenders.own_rewards,
        "left_out": contenders.left_out,
        "seconds": run.seconds,
    }
    write_json(run.path / RESULTS_FILE, results)
    for sheet in sheets:
        say(sheet.rich())
