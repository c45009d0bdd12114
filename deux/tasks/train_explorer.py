"""`task=train_explorer`: train the policy of a learned explorer with PPO."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import torch
from omegaconf import DictConfig

from deux.configuration import run_folder, sections_of
from deux.contracts import Reward, SceneReference
from deux.environment.egocentric import Crops
from deux.environment.exploration_env import ExplorationEnv
from deux.environment.memory import RESOLUTION
from deux.environment.scene_pool import ScenePool
from deux.errors import DeuxError, check_range, counted
from deux.figures.drawing import save_figure
from deux.figures.training_curves import draw_learning_curve
from deux.policies.learned_explorer import LearnedExplorer
from deux.policies.policy_files import POLICY_FILE, TrainedPolicy, save_policy
from deux.policies.ppo import LearningCurve, train_policy
from deux.policies.ppo_settings import PPOSettings
from deux.registry import registry
from deux.simulator.simulation import Simulation
from deux.task_sections import Sections
from deux.tasks.command_lines import command_line
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.datasets import further_scenes, read_scenes, read_simulation
from deux.tasks.run_folder import open_run_folder

CAMERA_PIXELS = 64
"""Height and width of the depth images in training; sufficient for a map with cells of 0.1 m."""


@dataclass(frozen=True)
class ExplorerTrainingSettings(PPOSettings):
    """Options of the training of a policy.

    Args:
        source: scene source of the training scenes, which are not among the experiment's.
        scenes: number of scenes of that source; None to train in `scenes.train`.
        reward_options: options of the reward's constructor.

    Raises:
        DeuxError: a value is out of its range.
    """

    source: str | None = None
    scenes: int | None = None
    reward_options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.scenes is not None:
            check_range("explorer_training.scenes", self.scenes, 1)


def run(cfg: DictConfig) -> None:
    """Train the explorer's policy, or resume where an earlier attempt in the same folder stopped."""
    quieten_libraries()
    sections = sections_of(cfg)
    settings = sections.read("explorer_training", ExplorerTrainingSettings)
    explorer, seed = sections.plugin("explore"), sections.seed
    reward = _reward_name(explorer.name)
    if (weights := explorer.settings.get("weights")) is not None:
        raise DeuxError(
            f"explore.weights={weights} has no effect with task=train_explorer, which trains a new policy: leave it "
            "out."
        )
    scenes = _scenes(sections, settings)
    pool = _pool(read_simulation(sections))
    with open_run_folder(run_folder(), sections.identity) as run:
        say(f"{'This run is complete' if (run.path / POLICY_FILE).exists() else 'Run folder'}: {run.path}")
        say(
            f"Train {explorer.name} in {counted(len(scenes), 'scene')}: {counted(settings.steps, 'step')} for the "
            f"reward {reward}"
        )
        with progress() as report, run.stage("train"):
            make = partial(_environment, reward, settings, scenes, pool)
            result = train_policy(settings, make, seed, run.path, report)
        provenance = {
            "reward": reward,
            "seed": seed,
            "scenes": [scene.identity for scene in scenes],
            "settings": asdict(settings),
            "torch": torch.__version__,
            "curve": asdict(result.curve),
        }
        policy = TrainedPolicy(result.network, Crops(), RESOLUTION, result.reward_state, provenance)
        save_policy(run.path / POLICY_FILE, policy)
        curve = result.curve
        figure = draw_learning_curve(curve.steps, curve.reward, curve.area, reward)
        save_figure(figure, run.figures / "learning_curve.png")
        _report(curve)
        options = {"explore": explorer.name, "explore.weights": run.path / POLICY_FILE}
        say(f"Explore with it: {command_line(options)}")


def _reward_name(name: str) -> str:
    explorer = registry().get("explorers", name)
    if issubclass(explorer, LearnedExplorer):
        return explorer.reward
    names = registry().names("explorers")
    learned = [other for other in names if issubclass(registry().get("explorers", other), LearnedExplorer)]
    raise DeuxError(f"explore={name} is not a learned explorer: task=train_explorer takes {', '.join(learned)}.")


def _scenes(sections: Sections, settings: ExplorerTrainingSettings) -> tuple[SceneReference, ...]:
    if settings.scenes is None:
        return read_scenes(sections, ["train"]).train
    if settings.source is None:
        raise DeuxError(
            "explorer_training.source is missing: set it to a scene source, or set explorer_training.scenes=null."
        )
    return further_scenes(settings.source, settings.scenes, read_scenes(sections, []))


def _pool(simulation: Simulation) -> ScenePool:
    """A pool of scenes that all environments of a process share."""
    camera = replace(simulation.camera, width=CAMERA_PIXELS, height=CAMERA_PIXELS)
    return ScenePool(replace(simulation, camera=camera), colors=False)


def _environment(
    reward: str, settings: ExplorerTrainingSettings, scenes: tuple[SceneReference, ...], pool: ScenePool
) -> ExplorationEnv:
    reward_function: Reward = registry().create("rewards", reward, settings.reward_options)
    return ExplorationEnv(scenes, reward_function, steps=settings.episode, pool=pool)


def _report(curve: LearningCurve) -> None:
    if not curve.steps:
        say("No episode was completed: explorer_training.steps is too small for results.")
        return
    say(
        f"Reward of an episode: {curve.reward[0]:.2f} after {counted(curve.steps[0], 'step')}, {curve.reward[-1]:.2f} "
        f"after {curve.steps[-1]}; area seen {curve.area[0]:.1f} and {curve.area[-1]:.1f} m²"
    )
