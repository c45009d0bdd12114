"""What a comparison of explorers found: its episodes, and each explorer's means with their intervals."""

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
    """One explorer's episode.

    Args:
        explorer: its registered name.
        scene: the scene's name.
        episode: number of the episode in this scene.
        seed: of the start and of the explorer.
        exploration: what it came to.
        trajectory: x and z in metres and yaw in radians of each frame.
        seconds: that it took.
        floor: the floor that it took place on, as the simulator numbers them.
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

    Scenes are what differs independently: the episodes of one scene are averaged first, and the intervals are over
    scenes.

    Args:
        episodes: all of them; the explorers keep the order in which they come.
        own_rewards: the reward that an explorer was trained for, by the explorer's name.
    """

    def __init__(self, episodes: Sequence[ExplorationEpisode], own_rewards: Mapping[str, str]) -> None:
        self.episodes = episodes
        self.own_rewards = own_rewards
        self.explorers = tuple(dict.fromkeys(episode.explorer for episode in episodes))
        self.rewards = tuple(dict.fromkeys(name for episode in episodes for name in episode.exploration.rewards))
        self.names = (*MEASURES, *(REWARD + reward for reward in self.rewards))
        """The numbers that are compared, as in `Exploration.values`."""

    def sample(self, explorer: str, name: str) -> dict[str, float]:
        """One of an explorer's numbers in each scene that has it, by the scene's name."""
        found = defaultdict(list)
        for episode in self.episodes:
            value = episode.exploration.values().get(name)
            if episode.explorer == explorer and value is not None:
                found[episode.scene].append(value)
        return {scene: sum(values) / len(values) for scene, values in found.items()}

    def estimate(self, explorer: str, name: str) -> Estimate:
        """One of an explorer's numbers over all scenes."""
        return estimate(list(self.sample(explorer, name).values()))

    def gain(self, explorer: str, baseline: str, name: str) -> Estimate:
        """How much higher an explorer's number is than another's: the difference in each scene, over all scenes.

        Both begin at the same places, so what makes one scene richer than another cancels out.
        """
        mine, theirs = self.sample(explorer, name), self.sample(baseline, name)
        return estimate([mine[scene] - theirs[scene] for scene in mine if scene in theirs])

    def summary(self) -> dict[str, dict[str, dict[str, float | None]]]:
        """Each explorer's numbers as JSON values: their means, and half the width of their intervals."""
        return {
            explorer: {name: _values(self.estimate(explorer, name)) for name in self.names}
            for explorer in self.explorers
        }

    def table_csv(self) -> str:
        """One row an explorer: each number's mean, and the ends of its interval."""
        rows = []
        for explorer in self.explorers:
            row: dict[str, Any] = {"explorer": explorer}
            for name in self.names:
                mean, half_width = self.estimate(explorer, name)
                row |= {name: mean, f"{name}_low": mean - half_width, f"{name}_high": mean + half_width}
            rows.append(row)
        return _csv(rows)

    def episodes_csv(self) -> str:
        """One row an episode."""
        rows = []
        for episode in self.episodes:
            row = {name: getattr(episode, name) for name in ("explorer", "scene", "floor", "episode", "seed")}
            row |= {"frames": len(episode.trajectory), **dict.fromkeys(self.names), **episode.exploration.values()}
            rows.append(row)
        return _csv(rows)


def _values(value: Estimate) -> dict[str, float | None]:
    return {"mean": _known(value.mean), "half_width": _known(value.half_width)}


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    return csv_text(list(rows[0]), [[_known(value) for value in row.values()] for row in rows])


def _known(value: Any) -> Any:
    """None in place of NaN, which JSON does not have."""
    return None if isinstance(value, float) and math.isnan(value) else value
