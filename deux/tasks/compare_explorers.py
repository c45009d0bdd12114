"""`task=compare_explorers`: run all explorers in the test scenes; tables of exploration metrics, and trajectories."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig

from deux.collection.collect_settings import CollectSettings
from deux.collection.perception import Perception, needs_model
from deux.collection.sparse import SparseSettings
from deux.configuration import run_folder, sections_of
from deux.contracts import DepthModel, SceneReference
from deux.errors import DeuxError, check_range, counted, plural
from deux.figures.drawing import save_figure
from deux.figures.trajectory_grid import Trajectory, draw_trajectory_grid
from deux.inference.precision import FastPredictor
from deux.io.atomic import read_bytes, write_atomically, write_json
from deux.metrics.tables import ResultTable
from deux.report.results import RESULTS_FILE
from deux.studies.comparison_episodes import compare_explorers
from deux.studies.comparison_tables import exploration_table, gains_table, rewards_table
from deux.studies.exploration_meter import trajectory_map
from deux.studies.explorer_comparison import ExplorationEpisode, ExplorerComparison
from deux.studies.participants import find_participants
from deux.task_sections import Sections
from deux.tasks.console import progress, quieten_libraries, say
from deux.tasks.datasets import check_robot, read_scenes, read_simulation
from deux.tasks.run_folder import EPISODES, RunFolder, open_run_folder
from deux.tasks.seed_model import SeedModelSettings


@dataclass(frozen=True)
class CompareSettings:
    """Options of the comparison of explorers, which explore the test scenes.

    Args:
        explorers: registered names; None for all installed explorers.
        steps: actions per episode.
        seeds: episodes per scene.
        baseline: the explorer that the others are compared with, scene by scene.
        figure_scene: index of the test scene whose trajectories are drawn, from 0.

    Raises:
        DeuxError: a value is out of its range.
    """

    explorers: tuple[str, ...] | None
    steps: int
    seeds: int
    baseline: str
    figure_scene: int

    def __post_init__(self) -> None:
        if self.explorers is not None and not self.explorers:
            raise DeuxError("compare.explorers is empty: list some, or set it to null for all installed explorers.")
        check_range("compare.steps", self.steps, 2)
        check_range("compare.seeds", self.seeds, 1)
        check_range("compare.figure_scene", self.figure_scene, 0)


def run(cfg: DictConfig) -> None:
    """Compare the explorers, from where an earlier attempt in the same folder stopped."""
    quieten_libraries()
    stages = ComparisonStages(sections_of(cfg))
    with open_run_folder(run_folder(), stages.identity) as run:
        say(f"Run folder: {run.path}")
        comparison = stages.explore(run)
        if comparison.episodes:
            stages.draw(comparison, run)
            stages.write(comparison, run)
            say(f"Tables, episodes and trajectories: {run.path}")
        if stages.failed:
            failures = "; ".join(f"{name} failed, {reason}" for name, reason in stages.failed.items())
            raise DeuxError(f"{failures}. The same command repeats only the failed episodes.")


class ComparisonStages:
    """The stages of a comparison of explorers.

    Args:
        sections: configuration.

    Raises:
        DeuxError: an option is wrong, or a chosen explorer cannot take part.
    """

    def __init__(self, sections: Sections) -> None:
        self._task, self._seed = sections.task, sections.seed
        self._settings = sections.read("compare", CompareSettings)
        self._collect = sections.read("collect", CollectSettings)
        self._simulation = read_simulation(sections)
        self._scenes = read_scenes(sections, ["test"]).test
        if self._settings.figure_scene >= (count := len(self._scenes)):
            raise DeuxError(
                f"compare.figure_scene is {self._settings.figure_scene}, but there {plural('is', count)} "
                f"{counted(count, 'scene')}, counted from 0."
            )
        seed_model = sections.read("seed_model", SeedModelSettings)
        chosen = seed_model.choose(sections.plugin("model"))
        configured = sections.plugin("explore")
        check_robot(configured, "task=compare_explorers")
        self._participants = find_participants(self._settings.explorers, configured, seed_model.is_ready(chosen))
        # Loading takes seconds, so the model is loaded only if an explorer needs it.
        guide = seed_model.load(chosen) if any(map(needs_model, self._participants.explorers)) else None
        self._perception = None if guide is None else _perception(sections, guide.model, self._collect)
        self.failed: dict[str, str] = {}
        self.identity = sections.identity | {
            "participants": self._participants.identity,
            "seed model": None if guide is None else guide.weights,
        }

    def explore(self, run: RunFolder) -> ExplorerComparison:
        """Run every explorer in every scene."""
        for name, reason in self._participants.left_out.items():
            say(f"Without {name}: {reason}")
        explorers = self._participants.explorers
        say(f"Explore {counted(len(self._scenes), 'scene')} with {', '.join(choice.name for choice in explorers)}")
        with run.stage("explore"), progress() as report:
            episodes, failed = compare_explorers(
                run.path / EPISODES,
                self._simulation,
                self._scenes,
                explorers,
                self._participants.rewards,
                self._seed,
                self._settings.steps,
                self._settings.seeds,
                self._perception,
                self._collect.make_executor(),
                report,
            )
        self.failed = {name: _failure(files) for name, files in failed.items()}
        own_rewards = {name: reward for name, reward in self._participants.own_rewards.items() if name not in failed}
        return ExplorerComparison(episodes, own_rewards)

    def draw(self, comparison: ExplorerComparison, run: RunFolder) -> None:
        """Draw each explorer's first episode in one scene."""
        with run.stage("draw"):
            scene = self._scenes[self._settings.figure_scene]
            simulator = self._simulation.make(scene)
            trajectories = []
            for episode in _first_episodes(comparison.episodes, scene):
                seen = trajectory_map(simulator, episode.trajectory)
                title = f"{episode.explorer}: {episode.exploration.area_seen:.0f} m²"
                path = np.array(episode.trajectory)[:, :2]
                trajectories.append(Trajectory(title, path, seen.frame, seen.cells))
            figure = draw_trajectory_grid(simulator.free_space(), trajectories)
            save_figure(figure, run.figures / "trajectories.png")

    def write(self, comparison: ExplorerComparison, run: RunFolder) -> None:
        """Write the tables and, last, `results.json`; print the tables."""
        tables = self._tables(comparison)
        left_out = self._participants.left_out | self.failed
        steps = counted(self._settings.steps, "step")
        amount = f"{counted(len(self._scenes), 'scene')}, {self._settings.seeds} x {steps} in each"
        page = [f"# Explorers compared: {amount}", "", *(table.markdown() for table in tables)]
        page += [f"Without {name}: {reason}\n" for name, reason in left_out.items()]
        write_atomically(run.path / "table.md", "\n".join(page).encode())
        write_atomically(run.path / "table.csv", comparison.table_csv().encode())
        write_atomically(run.path / "episodes.csv", comparison.episodes_csv().encode())
        results: dict[str, Any] = {
            "task": self._task,
            "scenes": [scene.name for scene in self._scenes],
            "steps": self._settings.steps,
            "seeds": self._settings.seeds,
            "seed": self._seed,
            "explorers": comparison.summary(),
            "own_rewards": comparison.own_rewards,
            "left_out": left_out,
            "seconds": run.seconds,
        }
        write_json(run.path / RESULTS_FILE, results)
        for table in tables:
            say(table)

    def _tables(self, comparison: ExplorerComparison) -> list[ResultTable]:
        tables = [exploration_table(comparison), rewards_table(comparison)]
        baseline = self._settings.baseline
        if baseline in comparison.explorers and len(comparison.explorers) > 1:
            tables.append(gains_table(comparison, baseline))
        return tables


def _perception(sections: Sections, model: DepthModel, collect: CollectSettings) -> Perception:
    """Depth prediction and uncertainty by the seed model."""
    predictor = FastPredictor(model, sections.plain("trainer").get("accelerator", "auto"))
    sparse = sections.read("sampling", SparseSettings)
    return Perception(predictor, sparse, collect.measure.create(), collect.correct_depth, collect.remembered_frames)


def _failure(files: Sequence[Path]) -> str:
    """Summary of an explorer's failures, from the files with the stack traces."""
    last = read_bytes(files[0]).decode(errors="replace").strip().splitlines()[-1]
    return f"in {counted(len(files), 'episode')} with {last}: {files[0]} has the stack trace"


def _first_episodes(episodes: Sequence[ExplorationEpisode], scene: SceneReference) -> list[ExplorationEpisode]:
    """Each explorer's first episode in a scene."""
    return [episode for episode in episodes if (episode.scene, episode.floor, episode.episode) == (scene.name, 0, 0)]
