"""The results of a comparison of explorers: episodes, and means with confidence intervals."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deux.metrics.intervals import Estimate, estimate
from deux.metrics.tables import csv_text
from deux.studies.exploration_meter import MEASURES, REWARD, Exploration


@dataclass(frozen=True)
class ExplorationEpisode:
    """One episode of an explorer.

    Args:
        explorer: registered name of the explorer.
        scene: name of the scene.
        episode: number of the episode in this scene.
        seed: seed of the start pose and the explorer.
        exploration: metrics of the episode.
        trajectory: x and z in metres and yaw in radians of each frame.
        seconds: duration of the episode.
        floor: floor of the scene, an index into `Simulator.floors`.
    """

    explorer: str
    scene: str
    episode: int
    seed: int
    exploration: Exploration
    trajectory: Sequence[tuple[float, float, float]]
    seconds: float
    floor: int = 0


class ExplorerComparison:
    """The episodes of several explorers in the same scenes.

    Scenes are the independent samples: the episodes of a scene are averaged first, and intervals are over scenes.

    Args:
        episodes: all episodes; they determine the order of the explorers.
        own_rewards: the reward that an explorer was trained with, by the explorer's name.
    """

    def __init__(self, episodes: Sequence[ExplorationEpisode], own_rewards: Mapping[str, str]) -> None:
        self.episodes = episodes
        self.own_rewards = own_rewards
        self.explorers = tuple(dict.fromkeys(episode.explorer for episode in episodes))
        self.rewards = tuple(dict.fromkeys(name for episode in episodes for name in episode.exploration.rewards))
        self.names = (*MEASURES, *(REWARD + reward for reward in self.rewards))
        """Names of the compared metrics, as in `Exploration.values`."""

    def sample(self, explorer: str, name: str) -> dict[str, float]:
        """An explorer's metric in each scene that has a value, by the scene's name."""
        samples = defaultdict(list)
        for episode in self.episodes:
            value = episode.exploration.values().get(name)
            if episode.explorer == explorer and value is not None:
                samples[episode.scene].append(value)
        return {scene: sum(values) / len(values) for scene, values in samples.items()}

    def estimate(self, explorer: str, name: str) -> Estimate:
        """Mean and interval of an explorer's metric over scenes."""
        return estimate(list(self.sample(explorer, name).values()))

    def gain(self, explorer: str, baseline: str, name: str) -> Estimate:
        """Mean difference of a metric between an explorer and a baseline, paired by scene.

        Both start at the same poses, so that differences between scenes cancel.
        """
        values, baselines = self.sample(explorer, name), self.sample(baseline, name)
        return estimate([values[scene] - baselines[scene] for scene in values if scene in baselines])

    def summary(self) -> dict[str, dict[str, dict[str, float | None]]]:
        """Mean and half width of the interval of each explorer's metrics, as JSON values."""
        return {
            explorer: {name: _values(self.estimate(explorer, name)) for name in self.names}
            for explorer in self.explorers
        }

    def table_csv(self) -> str:
        """CSV with a row for each explorer: mean and ends of the interval of each metric."""
        rows = []
        for explorer in self.explorers:
            row: dict[str, Any] = {"explorer": explorer}
            for name in self.names:
                mean, half_width = self.estimate(explorer, name)
                row |= {name: mean, f"{name}_low": mean - half_width, f"{name}_high": mean + half_width}
            rows.append(row)
        return _csv(rows)

    def episodes_csv(self) -> str:
        """CSV with a row for each episode."""
        rows = []
        for episode in self.episodes:
            row = {name: getattr(episode, name) for name in ("explorer", "scene", "floor", "episode", "seed")}
            row |= {"frames": len(episode.trajectory), **dict.fromkeys(self.names), **episode.exploration.values()}
            rows.append(row)
        return _csv(rows)


def _values(value: Estimate) -> dict[str, float | None]:
    return {"mean": _nan_to_none(value.mean), "half_width": _nan_to_none(value.half_width)}


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    return csv_text(list(rows[0]), [[_nan_to_none(value) for value in row.values()] for row in rows])


def _nan_to_none(value: Any) -> Any:
    """Replace NaN, which JSON does not have, by None."""
    return None if isinstance(value, float) and math.isnan(value) else value
