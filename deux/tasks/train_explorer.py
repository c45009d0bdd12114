"""`task=train_explorer`: train the policy of a learned explorer with PPO."""

from dataclasses import asdict, replace
from functools import partial

import torch
from omegaconf import DictConfig

from deux.configuration import run_folder
from deux.contracts import Reward
from deux.environment.egocentric import Crops
from deux.environment.exploration_env import ExplorationEnv
from deux.environment.memory import RESOLUTION
from deux.environment.scene_pool import ScenePool
from deux.errors import DeuxError
from deux.figures.drawing import save_figure
from deux.figures.learning_curve import draw_learning_curve
from deux.policies.learned_explorer import LearnedExplorer
from deux.policies.policy_files import POLICY_FILE, TrainedPolicy, save_policy
from deux.policies.ppo import LearningCurve, train_policy
from deux.registry import registry
from deux.scenes.sources import SceneReference, synthetic_scenes
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.run_folder import RunFolder
from deux.tasks.settings import Settings

CAMERA_PIXELS = 64
"""Rows and columns of the depth images in training: enough for a map with cells of 0.1 m."""


def run(cfg: DictConfig) -> None:
    """Train the explorer's policy, from where an earlier attempt in the same folder stopped."""
    quieten_libraries()
    settings = Settings(cfg)
    chosen = settings.explorer_training
    reward = _reward_name(settings)
    run = RunFolder(run_folder(), settings.identity)
    scenes = _scenes(settings)
    say(f"Run folder: {run.path}")
    say(f"Train {settings.explorer.name} in {len(scenes)} scenes: {chosen.steps} steps for the reward {reward}")
    with progress() as report, run.stage("train"):
        make = partial(_environment, reward, scenes, settings, _pool(settings))
        result = train_policy(chosen, make, settings.seed, run.path, report)
    made_by = {
        "reward": reward,
        "random_seed": settings.seed,
        "scenes": [scene.identity for scene in scenes],
        "settings": asdict(chosen),
        "torch": torch.__version__,
        "curve": asdict(result.curve),
    }
    policy = TrainedPolicy(result.network, Crops(), RESOLUTION, result.reward_state, made_by)
    save_policy(run.path / POLICY_FILE, policy)
    curve = result.curve
    save_figure(draw_learning_curve(curve.steps, curve.reward, curve.area, reward), run.figures / "learning_curve.png")
    _report(curve)
    say(f"Explore with it: python -m deux explore={settings.explorer.name} explore.weights={run.path / POLICY_FILE}")


def _reward_name(settings: Settings) -> str:
    explorer = registry().get("explorers", settings.explorer.name)
    if issubclass(explorer, LearnedExplorer):
        return explorer.reward
    names = registry().names("explorers")
    learned = [name for name in names if issubclass(registry().get("explorers", name), LearnedExplorer)]
    raise DeuxError(f"explore={settings.explorer.name} learns nothing: task=train_explorer takes {', '.join(learned)}.")


def _scenes(settings: Settings) -> tuple[SceneReference, ...]:
    flats = settings.explorer_training.flats
    return settings.splits.train if flats is None else synthetic_scenes(flats, settings.splits)


def _make_reward(name: str, settings: Settings) -> Reward:
    reward: Reward = registry().create("rewards", name, settings.explorer_training.reward_options)
    return reward


def _pool(settings: Settings) -> ScenePool:
    """The scenes, which all environments of a process share."""
    camera = replace(settings.camera, width=CAMERA_PIXELS, height=CAMERA_PIXELS)
    return ScenePool(camera, settings.robot, textured=False, renderer=settings.run.renderer)


def _environment(
    reward: str, scenes: tuple[SceneReference, ...], settings: Settings, pool: ScenePool
) -> ExplorationEnv:
    return ExplorationEnv(scenes, _make_reward(reward, settings), steps=settings.explorer_training.episode, pool=pool)


def _report(curve: LearningCurve) -> None:
    if not curve.steps:
        say("No episode came to its end: explorer_training.steps is too small to tell anything.")
        return
    say(
        f"Reward of an episode: {curve.reward[0]:.2f} after {curve.steps[0]} steps, {curve.reward[-1]:.2f} after "
        f"{curve.steps[-1]}; area seen {curve.area[0]:.1f} and {curve.area[-1]:.1f} m²"
    )
